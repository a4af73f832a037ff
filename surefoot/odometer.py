"""Where a camera in the hand is, by its own depth images: for recordings that come without poses.

`Odometer` takes the frames of a recording one by one: floor, odometry, places; `way` joins them to the
trajectory of the whole, in an upright world that begins under the camera where the first floor was seen.
`Tracked` is the same as a `Whereabouts`, so that the cycle maps such recordings as it does those with poses.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from perception import points, structured_light
from perception.floor import choose
from perception.floor.choose import FloorConfig
from perception.floor.prior import handheld_prior
from perception.levelling import UP, shadow
from perception.localisation.factors import turned_covariance
from perception.localisation.filter import UpdateReport
from perception.localisation.registration import RegistrationReport
from perception.localisation.smoother import Solution
from perception.odometry.back_end import BackEnd, BackEndConfig
from perception.odometry.claims import Claims, joined
from perception.odometry.odometry import FIRST, LOST, RESTARTED, Odometry, OdometryConfig, Step
from perception.odometry.pyramid import Pyramid, PyramidConfig, build
from perception.primitives.errors import InputError
from perception.primitives.frame import Depth, Frame
from perception.primitives.gaussian import Gaussian
from perception.primitives.landmark import Sighting
from perception.primitives.plane import Plane
from perception.primitives.pose import Pose3

from .whereabouts import Placed, PriorConfig, Standing


@dataclass(frozen=True)
class OdometerConfig:
    """Everything between a depth image and the trajectory."""

    pyramid: PyramidConfig = field(default_factory=PyramidConfig)
    odometry: OdometryConfig = field(default_factory=OdometryConfig)
    back_end: BackEndConfig = field(default_factory=BackEndConfig)
    floor: FloorConfig = field(default_factory=FloorConfig)
    light: structured_light.StructuredLightConfig = field(
        default_factory=structured_light.StructuredLightConfig
    )
    nearest_m: float = 0.3  # as the reach of RGB-D cameras
    farthest_m: float = 6.0  # likewise
    floor_stride: int = 4  # ours: every fourth pixel each way tells the floor as well
    loops: bool = True
    floor_tilt_deg: float = 3.0  # ours: floor against the former ones and the way between
    floor_height_m: float = 0.08  # ours: likewise


class Odometer:
    """Frames in, the camera's way out."""

    def __init__(self, rng: np.random.Generator, config: OdometerConfig | None = None) -> None:
        self.config = config or OdometerConfig()
        self.odometry = Odometry(replace(self.config.odometry, reuse=not self.config.loops))
        self.back_end = BackEnd(rng, self.config.back_end) if self.config.loops else None
        self.states: list[str] = []
        self._rng = rng
        self._T_world_start: Pose3 | None = None

    @property
    def T_world_start(self) -> Pose3 | None:
        """The first image's axes in the upright world; None until a floor is seen."""
        return self._T_world_start

    def take(self, frame: Frame) -> Step:
        """Place the next frame.

        Raises:
            InputError: It has no depth image.
        """
        if frame.depth is None:
            raise InputError(
                f"odometry: the frame at {frame.stamp_s} s has no depth image; give a recording of depth"
            )
        depth = structured_light.depth(frame.depth, self.config.light)
        rgb = None if frame.colour is None else frame.colour.rgb
        if rgb is not None and rgb.shape[:2] != depth.z.shape:
            rgb = None  # not registered to the depth: of no use here
        return self.take_images(depth, rgb)

    def take_images(self, depth: Depth, rgb: np.ndarray | None) -> Step:
        """Place the next depth image, with its picture if there is one."""
        floor = self._floor(depth)
        image = build(depth, rgb, floor, self.config.pyramid)
        step = self.odometry.track(image)
        if self.back_end is not None:
            here = self.odometry.references[-1].number == len(self.states)
            self.back_end.take(step, image, here)
        self._upright(image, step)
        self.states.append(step.state)
        return step

    def way(self) -> tuple[list[Pose3], Solution | None]:
        """T_world_camera of every frame so far with loops closed, and the graph's solution."""
        if self.back_end is None:
            raise InputError("odometry: loops were switched off; the steps are the way")
        solution = self.back_end.solve()
        return self.back_end.trajectory(solution), solution

    def claims(self, solution: Solution | None) -> Claims | None:
        """How far each pose of `way` may be off; None without a solution."""
        return None if self.back_end is None else self.back_end.claims(solution)

    def _floor(self, depth: Depth) -> Plane | None:
        c = self.config
        seen = points.from_depth(depth, c.nearest_m, c.farthest_m, c.floor_stride)
        found = choose.find(seen, handheld_prior(None), self._rng, c.floor, "depth")
        return None if found is None else found.plane

    def _upright(self, image: Pyramid, step: Step) -> None:
        """The first floor says what is up."""
        if self._T_world_start is None and image.floor is not None and step.state != LOST:
            self._T_world_start = shadow(image.floor) @ step.T_start_camera.inverse()


class Tracked:
    """A camera in the hand that follows its own way.

    The map frame is upright by the first floor seen. A lost frame keeps the last pose, is placed nowhere, and
    so adds nothing to any map. As long as no frame has been laid over another, these may be single pictures:
    each then stands alone, over its own shadow.
    """

    def __init__(
        self,
        rng: np.random.Generator,
        prior: PriorConfig,
        config: OdometerConfig | None = None,
    ) -> None:
        self._prior = prior
        self.odometer = Odometer(rng, config)
        self._step: Step | None = None
        self._covariances: dict[
            int, Float[np.ndarray, "6 6"]
        ] = {}  # of references, and of the latest
        self._covariance = np.zeros((6, 6))

    @property
    def T_map_camera(self) -> Pose3 | None:
        """The camera in the upright map frame; None until a floor is seen."""
        start = self.odometer.T_world_start
        return None if start is None or self._step is None else start @ self._step.T_start_camera

    @property
    def _alone(self) -> bool:
        """Whether no depth image, or none beside the first, was laid over another."""
        states = self.odometer.states
        return len(states) != 1 and all(one in (FIRST, LOST, RESTARTED) for one in states)

    @property
    def pose(self) -> Gaussian | None:
        """Below the camera, heading where it looks; None until a floor is seen, or if nothing was ever followed."""
        T = self.T_map_camera
        if T is None or self._alone:
            return None
        ahead = T.rotation[:, 2]
        mean = np.array([T.translation[0], T.translation[1], math.atan2(ahead[1], ahead[0])])
        start = self.odometer.T_world_start
        assert start is not None
        # this image's; the first's is carried along
        distortion = self.odometer.config.back_end.distortion
        covariance = turned_covariance(self._covariance + distortion, start.rotation)
        planar = np.ix_([0, 1, 5], [0, 1, 5])
        floor = np.diag([1e-4**2, 1e-4**2, 1e-4**2])  # where the world begins is known
        return Gaussian(mean, covariance[planar] + floor)

    def update(self, frame: Frame, sightings: Sequence[Sighting]) -> UpdateReport | None:
        """Follow the camera; a frame without depth leaves it where it was."""
        if frame.depth is None:
            return None
        number = len(self.odometer.states)
        step = self._step = self.odometer.take(frame)
        first = self.odometer.config.back_end.distortion
        before = self._covariances.get(step.reference, first)
        reference = step.T_start_camera @ step.motion.inverse()
        self._covariance = joined(before, reference, step.motion, step.covariance)
        self._covariances[number] = self._covariance
        kept = {number, *(one.number for one in self.odometer.odometry.references)}
        self._covariances = {n: c for n, c in self._covariances.items() if n in kept}
        return None

    def register(self, seen: Sequence[Standing]) -> RegistrationReport | None:
        """Images have been laid over each other already."""
        return None

    def expected_floor(self, T_body_camera: Pose3 | None) -> Plane:
        """Horizontal, at height zero of the map; below somewhere while that is unknown."""
        T = self.T_map_camera
        if T is None or self._alone or not T.translation[2] > 0.0:
            return handheld_prior(None)
        c = self.odometer.config
        tilt = math.radians(c.floor_tilt_deg)
        return Plane(
            T.rotation.T @ UP,
            T.translation[2],
            np.diag([tilt**2, tilt**2, c.floor_height_m**2]),
        )

    def place(self, T_body_camera: Pose3 | None, floor: Plane | None) -> Placed | None:
        """Where odometry has it; a lost camera is nowhere."""
        if self._alone:
            return None if floor is None else Placed(shadow(floor), floor)
        T = self.T_map_camera
        if T is None or self._step is None or self._step.state in (LOST, RESTARTED):
            return None
        return Placed(T, floor or self.expected_floor(T_body_camera))
