"""Depth images of a recording with the camera's pose of each, from the pose source that fits the recording.

A recording with poses needs one pass. A camera without poses needs two: the first finds its trajectory by RGB-D
odometry and closes loops, the second reads the images again. A walking body is localised by the pipeline, as in
`surefoot process`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import UInt8

from perception.depth.sources import DepthSources, registered_picture
from perception.depth.undistortion import undistorted
from perception.floor.segmented_view import SegmentedView, near_moving_obstacles
from perception.localisation.camera_pose import CameraPoseSource
from perception.odometry.odometry import LOST, RESTARTED
from perception.odometry.pose_uncertainty import PoseUncertainty
from perception.odometry.rgbd_odometry import Odometer
from perception.primitives.frame import Depth, Frame
from perception.primitives.obstacle import Obstacle
from perception.primitives.pose import Pose3

from ..config.schema import Config
from ..recordings.recording import Recording
from ..results.camera_trajectory import CameraTrajectory, write_poses
from ..results.run_folder import COVARIANCE_HEADER, RunFolder, estimate_row
from ..results.tracking import write_tracking
from ..results.trajectory_uncertainty import write_covariances
from ..run.pipeline import Pipeline
from .g2o import write_g2o
from .job import Say

ABOVE_FLOOR_M = 0.03  # ours: lower points below a moving obstacle are floor


class PlacedImage(NamedTuple):
    """A depth image without lens distortion, the picture of its pixels if there is one, and its pose."""

    depth: Depth
    rgb: UInt8[np.ndarray, "h w 3"] | None
    T_map_camera: Pose3


class PlacedImages(ABC):
    """Every depth image of a recording whose pose is known, in order of time.

    Attributes:
        frames: Frames with at least one placed image.
        with_depth: Frames with a depth image, placed or not.
        lost: Frames whose pose could not be found.
        doubtful: Frames whose pose is uncertain.
        closures: Closed loops.
        remark: What the summary should say about the poses, known after `write`.
    """

    def __init__(self, recording: Recording, config: Config) -> None:
        self.recording = recording
        self.config = config
        self.sources = DepthSources(
            config.tof, config.structured_light, config.stereo, config.depth_sources
        )
        self.frames = self.with_depth = self.lost = self.doubtful = self.closures = 0
        self.remark = ""

    @abstractmethod
    def images(self) -> Iterator[PlacedImage]:
        """The images, one after the other; a single pass."""

    @abstractmethod
    def write(self, folder: RunFolder) -> None:
        """Write the trajectory and its covariances, after the last image."""

    def _of_camera(self, frame: Frame, T_map_camera: Pose3) -> Iterator[PlacedImage]:
        """The images of a frame, given the pose of the camera that odometry uses.

        Another camera needs the place of both on the body; without it the image is left out.
        """
        main = self.sources.for_odometry(frame)
        if main is None:
            return
        self.with_depth += 1
        self.frames += 1
        for sensor, depth in self.sources.images(frame):
            T = T_map_camera
            if sensor != main.sensor:
                if main.depth.T_body_camera is None or depth.T_body_camera is None:
                    continue
                T = T @ main.depth.T_body_camera.inverse() @ depth.T_body_camera
            yield PlacedImage(*undistorted(depth, registered_picture(frame, sensor)), T)


def placed_images(recording: Recording, config: Config, say: Say) -> PlacedImages:
    """The images of a recording by its pose source: given poses, odometry, or the localiser of a body."""
    if recording.info.poses_given:
        return GivenCamera(recording, config)
    if recording.info.start is None:
        return OdometryCamera(recording, config, say)
    return WalkingBody(recording, config)


class GivenCamera(PlacedImages):
    """A camera whose poses came with the recording; without gravity or a floor their axes stay as they are."""

    def __init__(self, recording: Recording, config: Config) -> None:
        super().__init__(recording, config)
        self._trajectory = CameraTrajectory()
        pipeline = Pipeline(config, recording.info)
        assert isinstance(pipeline.pose_source, CameraPoseSource)
        self._source = pipeline.pose_source
        if self._source.T_map_origin is None:  # without gravity, the first floor seen defines up
            for frame in recording.frames():
                pipeline.cycle(frame)
                if self._source.T_map_origin is not None:
                    break
        self._T_map_world = self._source.T_map_origin or Pose3()

    def images(self) -> Iterator[PlacedImage]:
        """The images, one after the other."""
        for frame in self.recording.frames():
            self._source.update(frame, ())
            camera = self._source.camera
            if camera is None:
                self.with_depth += self.sources.for_odometry(frame) is not None
                continue
            self._trajectory.append(frame.stamp_s, camera)
            yield from self._of_camera(frame, self._T_map_world @ camera.T_origin_camera)

    def write(self, folder: RunFolder) -> None:
        """Write trajectory.txt and space_covariance.csv."""
        self._trajectory.write(folder, self._T_map_world)


class OdometryCamera(PlacedImages):
    """A camera without poses: odometry, with loops closed over the whole recording."""

    def __init__(self, recording: Recording, config: Config, say: Say) -> None:
        super().__init__(recording, config)
        rng = np.random.default_rng(config.seed)
        self._odometer = Odometer(rng, config.odometer, config.floor_of(recording.info.calibrated))
        stamps = []
        of = f" of {recording.info.frames}" if recording.info.frames else ""
        for frame in recording.frames():
            image = self.sources.for_odometry(frame)
            if image is None:
                continue
            step = self._odometer.track_images(image.depth, image.rgb, image.sensor)
            stamps.append(frame.stamp_s)
            say(f"trajectory: frame {len(stamps)}{of}, {step.state}")
        poses, self._solution = self._odometer.trajectory() if stamps else ([], None)
        states = self._odometer.states
        found = [state not in (LOST, RESTARTED) for state in states]
        self._poses = {s: p for s, p, known in zip(stamps, poses, found, strict=True) if known}
        self._found, self._stamps = found, stamps
        self.lost = len(found) - sum(found)
        self.doubtful = states.count("doubtful")
        if self._odometer.back_end is not None:
            self.closures = self._odometer.back_end.closures

    def images(self) -> Iterator[PlacedImage]:
        """The images, one after the other."""
        for frame in self.recording.frames():
            pose = self._poses.get(frame.stamp_s)
            if pose is None:
                self.with_depth += self.sources.for_odometry(frame) is not None
            else:
                yield from self._of_camera(frame, pose)

    def write(self, folder: RunFolder) -> None:
        """Write trajectory.txt, the two tables of covariances, tracking.csv and graph.g2o."""
        odometer = self._odometer
        self.remark = write_tracking(
            folder,
            self._stamps,
            odometer.states,
            odometer.failures,
            odometer.config.alarm.threshold,
        )
        write_poses(folder, "trajectory.txt", self._poses.items())
        uncertainty = self._odometer.uncertainty(self._solution)
        if uncertainty is not None:
            known = PoseUncertainty(
                uncertainty.from_start[self._found], uncertainty.aligned[self._found]
            )
            write_covariances(folder, list(self._poses), list(self._poses.values()), known)
        if self._solution is not None and self._odometer.back_end is not None:
            factors = self._odometer.back_end.factors
            write_g2o(folder.path("graph.g2o"), factors, self._solution)


class WalkingBody(PlacedImages):
    """A body with legs: the pipeline's poses; moving obstacles are left out of the images."""

    def __init__(self, recording: Recording, config: Config) -> None:
        super().__init__(recording, config)
        self._pipeline = Pipeline(config, recording.info)
        self._rows: list[tuple[float, ...]] = []

    def images(self) -> Iterator[PlacedImage]:
        """The images, one after the other."""
        for frame in self.recording.frames():
            estimate = self._pipeline.cycle(frame).estimate
            if estimate.pose is not None:
                self._rows.append(estimate_row(frame.stamp_s, estimate.pose))
            self.with_depth += bool(estimate.views)
            self.frames += bool(estimate.views)
            for view in estimate.views:
                depth, rgb = undistorted(
                    static(view, estimate.obstacles), registered_picture(frame, view.sensor)
                )
                yield PlacedImage(depth, rgb, view.T_map_camera)

    def write(self, folder: RunFolder) -> None:
        """Write trajectory_covariance.csv and trajectory.txt of the body."""
        if self._rows:
            folder.write_csv("trajectory_covariance.csv", COVARIANCE_HEADER, self._rows)
            folder.write_planar_trajectory()


def static(view: SegmentedView, obstacles: tuple[Obstacle, ...]) -> Depth:
    """The depth image of a view without the pixels of moving obstacles."""
    z = view.depth.z
    x, y = view.depth.camera.slopes
    points = view.T_map_camera.apply(np.stack(np.broadcast_arrays(x * z, y * z, z), axis=-1))
    near = near_moving_obstacles(points[..., :2].reshape(-1, 2).astype(np.float64), obstacles)
    moving = near.reshape(z.shape) & (points[..., 2] > ABOVE_FLOOR_M)
    return (
        replace(view.depth, z=np.where(moving, np.float32(np.nan), z))
        if moving.any()
        else view.depth
    )
