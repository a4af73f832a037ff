"""The pipeline on frames of a user's own, one by one."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mapping.objects.footprints import Footprint
from perception.depth.time_of_flight import raw_amplitude
from perception.primitives.camera import Camera
from perception.primitives.errors import InputError
from perception.primitives.frame import Frame, Imu, StepOdometry
from perception.primitives.landmark import Landmark
from perception.primitives.pose import Pose2, Pose3
from planning.world_model import WorldModel

from ..config.schema import Config
from ..recordings.codec import fault_of
from ..recordings.given_poses import far_pose
from ..recordings.recording import RecordingInfo
from ..run import pipeline as run_pipeline
from . import checks, views
from .checks import ArrayLike
from .verbs import configuration


class Pipeline:
    """From sensor data to pose, floor, obstacles, tracks and maps, frame by frame.

    It is the pipeline of `simulate` and `process`. The pose comes from one of three sources:

    - `start` is given: a walking body, by its step odometry, inertial sensor, landmarks and scan registration.
      Every image then needs `T_body_camera`.
    - The first frame has `T_world_camera`: poses of the camera are given with the frames.
    - Otherwise: visual odometry on the depth images.

    The map frame has z up from the floor. With `start` and landmarks it is the frame of these.
    """

    def __init__(
        self,
        config: Config | str | Path | None = None,
        *,
        landmarks: Sequence[Landmark] = (),
        start: Pose2 | None = None,
        start_covariance: ArrayLike | None = None,
        up_world: ArrayLike | None = None,
        calibrated: bool = False,
    ) -> None:
        """Begin with empty maps.

        Args:
            config: Settings, or a TOML file of them; None for the defaults.
            landmarks: Known fiducial tags, map frame; they need `start`.
            start: Pose of the body at the first frame, map frame.
            start_covariance: (3, 3) of (x, y, yaw) of the start, m and rad; None: 2 cm and 1 degree.
            up_world: (3,), direction that points up in the frame of `T_world_camera`; None: the first floor
                seen is horizontal.
            calibrated: Whether the depth hardly bends, which makes the covariance of floors smaller, as for
                `find_floor`.

        Raises:
            InputError: An argument has the wrong type or shape, or needs `start`.
        """
        self._config = configuration(config, {})
        up = None
        if up_world is not None:
            direction = checks.direction(up_world, "up_world")
            x, y, z = (direction / np.linalg.norm(direction)).tolist()
            up = (x, y, z)
        covariance = None
        if start_covariance is not None:
            covariance = checks.covariances(start_covariance, (3, 3), "start_covariance")
        self._info = RecordingInfo(
            name="frames",
            kind="frames",
            landmarks=checks.every(landmarks, Landmark, "landmarks"),
            start=checks.optional(start, Pose2, "start"),
            start_covariance=covariance,
            gravity_up_world=up,
            calibrated=checks.flag(calibrated, "calibrated"),
        )
        self._need_start(landmarks=self._info.landmarks or None, start_covariance=covariance)
        self._pipeline: run_pipeline.Pipeline | None = None
        self._world: WorldModel | None = None
        self._posed = False
        self._stamp_s = -math.inf

    @property
    def world(self) -> WorldModel | None:
        """The latest world model; None before the first frame."""
        return self._world

    def add(
        self,
        stamp_s: float,
        *,
        depth_m: ArrayLike | None = None,
        camera: Camera | None = None,
        scale_per_metre: float | None = None,
        range_m: ArrayLike | None = None,
        amplitude: ArrayLike | None = None,
        left: ArrayLike | None = None,
        right: ArrayLike | None = None,
        baseline_m: float | None = None,
        rgb: ArrayLike | None = None,
        rgb_camera: Camera | None = None,
        T_body_camera: Pose3 | None = None,
        T_world_camera: Pose3 | None = None,
        step: StepOdometry | Pose2 | None = None,
        imu: Imu | None = None,
        footstep_due: bool = False,
    ) -> WorldModel:
        """Take in what the sensors measured at one instant.

        A body whose cameras differ in intrinsics or mount uses `add_frame`.

        Args:
            stamp_s: Time, s; larger than at the previous call.
            depth_m: (h, w), depth along the optical axis of an RGB-D camera, m; integers need `scale_per_metre`.
            camera: Intrinsics of the depth, range or stereo images.
            scale_per_metre: Units per metre of integer depth or range.
            range_m: (h, w), range along the ray of a time-of-flight camera, m; same rules.
            amplitude: (h, w), of the return; 1 is that of a white target 2 m straight ahead. None: noise by range alone.
            left, right: (h, w), uint8, a stereo pair; grey or RGB.
            baseline_m: Distance of the pair, m.
            rgb: (h, w, 3), uint8, red first.
            rgb_camera: Its intrinsics; None: those of `camera`.
            T_body_camera: Camera on the body: z = 0 of the body frame is the floor, x ahead, y left.
            T_world_camera: Camera in the world, where poses are given.
            step: Motion of the body since the previous frame by its odometry; a `Pose2` counts as one step. It needs
                `start`.
            imu: Mean of the inertial sensor since the previous frame; it needs `start`.
            footstep_due: Whether the gait asks for its next step now.

        Returns:
            The world model: `pose` (Gaussian over x, y, yaw, or None), `floor` (Plane or None), `tracks`
            (obstacles, map frame), `grid` (occupancy round the robot), `confidence` (of its cells),
            `world_map` (occupancy of the whole run), `estimate` (everything of this frame). The maps are
            updated in place by later frames.

        Raises:
            InputError: Nothing to use, time not advancing, an image of the wrong type or shape, or arguments
                that do not fit together.
        """
        self._need_start(step=step, imu=imu)
        mount, scale = checks.optional(T_body_camera, Pose3, "T_body_camera"), scale_per_metre
        depth = tof = stereo = colour = None
        if depth_m is not None:
            depth = views.depth_view(depth_m, camera, scale, mount)
        if range_m is not None:
            tof = views.range_view(range_m, amplitude, camera, scale, mount)
        if left is not None or right is not None:
            stereo = views.stereo_view(left, right, baseline_m, camera, mount)
        if rgb is not None:
            colour = views.colour_view(rgb, camera if rgb_camera is None else rgb_camera, mount)
        odometry = step
        if step is not None and not isinstance(step, StepOdometry):
            odometry = StepOdometry(checks.instance(step, Pose2, "step"), 1.0)
        frame = Frame(
            checks.number(stamp_s, "stamp_s"),
            tof,
            depth,
            stereo,
            colour,
            checks.optional(odometry, StepOdometry, "step"),
            checks.optional(imu, Imu, "imu"),
            checks.optional(T_world_camera, Pose3, "T_world_camera"),
            checks.flag(footstep_due, "footstep_due"),
        )
        return self.add_frame(frame)

    def add_frame(self, frame: Frame) -> WorldModel:
        """Take in a frame, for instance of a `Recording`.

        Raises:
            InputError: As `add`.
        """
        self._check(checks.instance(frame, Frame, "frame"))
        if self._pipeline is None:
            self._posed = frame.T_world_camera is not None
            info = dataclasses.replace(self._info, poses_given=self._posed)
            self._pipeline = run_pipeline.Pipeline(self._config, info)
        self._world = self._pipeline.cycle(frame)
        self._stamp_s = frame.stamp_s
        return self._world

    def footprints(self) -> list[Footprint]:
        """Outlines of the static obstacles mapped so far, map frame; those of most points first."""
        return [] if self._pipeline is None else self._pipeline.maps.footprints()

    def _need_start(self, **given: object) -> None:
        """Refuse what only the localisation of a walking body uses, if there is none."""
        for name, value in given.items():
            if value is not None and self._info.start is None:
                raise InputError(
                    f"{name} needs start, the pose of a walking body; expected "
                    f"Pipeline(start=surefoot.Pose2(x, y, yaw)), or no {name}"
                )

    def _check(self, frame: Frame) -> None:
        """Refuse what the pipeline would leave aside without a word."""
        if not (math.isfinite(frame.stamp_s) and frame.stamp_s > self._stamp_s):
            raise InputError(
                f"stamp_s={frame.stamp_s} must be a number larger than the previous one ({self._stamp_s})"
            )
        fault = fault_of(frame) or far_pose(frame) or raw_amplitude(frame.tof)
        if fault:
            raise InputError(f"frame at {frame.stamp_s} s: {fault}")
        views = (frame.tof, frame.depth, frame.stereo, frame.colour)
        if (
            not any(view is not None for view in views)
            and frame.odometry is None
            and frame.imu is None
        ):
            raise InputError(
                "the frame is empty; give depth_m, range_m, a stereo pair or rgb, with start also step or imu"
            )
        given = frame.T_world_camera is not None
        if self._info.start is not None:
            if given:
                raise InputError("T_world_camera does not go with start; leave out one of them")
            if any(view is not None and view.T_body_camera is None for view in views):
                raise InputError("with start, every image needs T_body_camera")
        elif self._pipeline is not None and given and not self._posed:
            raise InputError(
                "T_world_camera comes late: the first frame had none, so the camera's pose is that of visual "
                "odometry; give it with every frame"
            )
        for name, image in (
            ("depth", None if frame.depth is None else frame.depth.depth),
            ("range_m", None if frame.tof is None else frame.tof.range_m),
        ):
            if image is not None and image.dtype.kind != "f":
                raise InputError(
                    f"{name} of the frame is {image.dtype}; expected float32 in m (see Pipeline.add)"
                )
