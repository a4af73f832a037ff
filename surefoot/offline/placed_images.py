"""Depth images of a recording with the camera's pose of each, from the pose source that fits the recording.

A recording with poses needs one pass. A camera without poses needs two: the first finds its trajectory by RGB-D
odometry and closes loops, the second reads the images again. A walking body is localised by the pipeline, as in
`surefoot process`.

A camera's map frame is upright, with its height zero on the floor that all its images show, whatever the axes of its
poses; x and y are theirs.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, UInt8

from perception.depth.points import from_depth
from perception.depth.sources import DepthSources, registered_picture
from perception.depth.undistortion import undistorted
from perception.floor.common_floor import FloorView, find_common, floor_view
from perception.floor.levelling import UP, rotation_between
from perception.floor.segmented_view import SegmentedView, near_moving_obstacles
from perception.localisation.given_poses import GivenPoses
from perception.odometry.odometry import LOST, RESTARTED
from perception.odometry.pose_uncertainty import PoseUncertainty, planar_gaussian
from perception.odometry.rgbd_odometry import Odometer
from perception.primitives.frame import Depth, Frame
from perception.primitives.gaussian import Gaussian
from perception.primitives.obstacle import Obstacle
from perception.primitives.plane import Plane
from perception.primitives.pose import Pose3
from perception.smoothing.factors import turned_covariance

from ..config.schema import Config
from ..progress import Say
from ..recordings.recording import Recording
from ..results.camera_trajectory import CameraTrajectory, write_poses
from ..results.run_folder import COVARIANCE_HEADER, RunFolder, estimate_row
from ..results.tracking import write_tracking
from ..results.trajectory_uncertainty import write_covariances
from ..run.pipeline import Pipeline
from .g2o import write_g2o

ABOVE_FLOOR_M = 0.03  # ours: lower points below a moving obstacle are floor
FLOOR_VIEWS = 100  # ours: images in which the floor is sought; more take long and tell no more
NO_FLOOR = (
    "no image shows the floor: height zero is that of the given poses, or of the first camera"
)


class PlacedImage(NamedTuple):
    """A depth image without lens distortion, the picture of its pixels if there is one, and its pose.

    Args:
        sensor: "tof", "stereo" or "depth".
        depth: The image.
        rgb: The picture.
        T_map_camera: Its pose.
        pose: (x, y, yaw) of the camera or body in the map, with covariance.
        floor: The floor below the image in the map, with covariance: errors of the floor and of the pose.
        stamp_s: Of its frame.
    """

    sensor: str
    depth: Depth
    rgb: UInt8[np.ndarray, "h w 3"] | None
    T_map_camera: Pose3
    pose: Gaussian
    floor: Plane
    stamp_s: float = 0.0


class PlacedImages(ABC):
    """Every depth image of a recording whose pose is known, in order of time.

    Attributes:
        frames: Frames with at least one placed image.
        with_depth: Frames with a depth image, placed or not.
        lost: Frames whose pose could not be found.
        doubtful: Frames whose pose is uncertain.
        closures: Closed loops.
        remarks: For the user, about floor and poses; complete after `write`.
    """

    def __init__(self, recording: Recording, config: Config) -> None:
        self.recording = recording
        self.config = config
        self.sources = DepthSources(
            config.tof,
            config.structured_light,
            config.stereo,
            config.depth_sources,
            recording.info.own_body,
        )
        self.frames = self.with_depth = self.lost = self.doubtful = self.closures = 0
        self.remarks: list[str] = []

    @abstractmethod
    def images(self) -> Iterator[PlacedImage]:
        """The images, one after the other; a single pass."""

    @abstractmethod
    def write(self, folder: RunFolder) -> None:
        """Write the trajectory and its covariances, after the last image."""


class CameraImages(PlacedImages):
    """Images of a camera that moves freely, on the common floor of all of them."""

    def __init__(self, recording: Recording, config: Config) -> None:
        super().__init__(recording, config)
        self._floor_config = config.floor_of(recording.info.calibrated)
        # of each: the stamp, and a view with its pose relative to the main camera
        self._views: list[tuple[float, FloorView]] = []
        self._every = self._offered = 0
        self.T_map_world = Pose3()
        self._floor = Plane(UP, 0.0)

    def _seen(self, frame: Frame) -> Iterator[tuple[str, Depth, np.ndarray | None, Pose3]]:
        """The images of a frame with their poses relative to the camera that odometry uses.

        Another camera needs the place of both on the body; without it the image is left out.
        """
        main = self.sources.for_odometry(frame)
        if main is None:
            return
        for sensor, depth in self.sources.images(frame):
            T = Pose3()
            if sensor != main.sensor:
                if main.depth.T_body_camera is None or depth.T_body_camera is None:
                    continue
                T = main.depth.T_body_camera.inverse() @ depth.T_body_camera
            yield sensor, *undistorted(depth, registered_picture(frame, sensor)), T

    def _look_for_floor(self, frame: Frame) -> None:
        """Keep the points of a frame for the floor search: of a long recording, those of every k-th frame."""
        self._offered += 1
        if self._offered % max(self._every, 1):
            return
        if len(self._views) >= FLOOR_VIEWS:
            self._views, self._every = self._views[1::2], 2 * max(self._every, 1)
        for sensor, depth, _, T_main_camera in self._seen(frame):
            reach = self.config.reach.of(sensor, depth)
            seen = from_depth(depth, reach.nearest_m, reach.farthest_m, reach.stride)
            self._views.append((frame.stamp_s, floor_view(seen, T_main_camera, sensor)))

    def _level(self, poses: dict[float, Pose3]) -> None:
        """Find the floor and with it the map frame, from the poses T_world_camera by stamp."""
        info = self.recording.info
        gravity = info.gravity_up_world if info.poses_given else None  # of the given poses' axes
        up = None if gravity is None else np.array(gravity, float)
        views = [
            view._replace(T_world_camera=poses[stamp] @ view.T_world_camera)
            for stamp, view in self._views
            if stamp in poses
        ]
        self._views = []
        rng = np.random.default_rng(self.config.seed)
        found = find_common(views, up, rng, self._floor_config)
        if found is not None:
            self.T_map_world = found.T_level_world
            self._floor = found.plane.moved(self.T_map_world)
            return
        if views:
            self.remarks.append(NO_FLOOR)
        if up is not None:
            height = info.floor_height_world_m or 0.0
            self.T_map_world = Pose3.from_rotation(
                rotation_between(up, UP), np.array([0.0, 0.0, -height])
            )

    def _of_camera(
        self, frame: Frame, T_world_camera: Pose3, covariance: Float[np.ndarray, "6 6"]
    ) -> Iterator[PlacedImage]:
        """The images of a frame, given the pose and covariance of the camera that odometry uses."""
        T_map_camera = self.T_map_world @ T_world_camera
        turned = turned_covariance(covariance, self.T_map_world.rotation)
        pose = planar_gaussian(T_map_camera, turned)
        floor = _floor_below(T_map_camera, self._floor, turned)
        images = list(self._seen(frame))
        self.with_depth += bool(images)
        self.frames += bool(images)
        for sensor, depth, rgb, T_main_camera in images:
            T = T_map_camera @ T_main_camera
            yield PlacedImage(sensor, depth, rgb, T, pose, floor, frame.stamp_s)


def _floor_below(T_map_camera: Pose3, floor: Plane, covariance: Float[np.ndarray, "6 6"]) -> Plane:
    """The floor in the map with the errors of a camera pose: its height and its tilt about the camera."""
    below = floor.moved(T_map_camera.inverse())
    tilt = 0.5 * float(covariance[3, 3] + covariance[4, 4])
    posed = below.covariance + np.diag([tilt, tilt, float(covariance[2, 2])])
    return Plane(below.normal, below.offset_m, posed).moved(T_map_camera)


def placed_images(recording: Recording, config: Config, say: Say) -> PlacedImages:
    """The images of a recording by its pose source: given poses, odometry, or the localiser of a body."""
    if recording.info.poses_given:
        return GivenCamera(recording, config)
    if recording.info.start is None:
        return OdometryCamera(recording, config, say)
    return WalkingBody(recording, config)


class GivenCamera(CameraImages):
    """A camera whose poses came with the recording."""

    def __init__(self, recording: Recording, config: Config) -> None:
        super().__init__(recording, config)
        self._trajectory = CameraTrajectory()
        self._source = GivenPoses(recording.info.gravity_up_world, config.prior)
        poses = {}
        for frame in recording.frames():
            if frame.T_world_camera is not None:
                poses[frame.stamp_s] = frame.T_world_camera
                self._look_for_floor(frame)
        self._level(poses)

    def images(self) -> Iterator[PlacedImage]:
        """The images, one after the other."""
        for frame in self.recording.frames():
            self._source.update(frame, ())
            camera = self._source.camera
            if camera is None:
                self.with_depth += self.sources.for_odometry(frame) is not None
                continue
            self._trajectory.append(frame.stamp_s, camera)
            covariance = camera.shared + camera.of_view
            yield from self._of_camera(frame, camera.T_origin_camera, covariance)

    def write(self, folder: RunFolder) -> None:
        """Write trajectory.txt and space_covariance.csv."""
        self._trajectory.write(folder, self.T_map_world)


class OdometryCamera(CameraImages):
    """A camera without poses: odometry, with loops closed over the whole recording."""

    def __init__(self, recording: Recording, config: Config, say: Say) -> None:
        super().__init__(recording, config)
        rng = np.random.default_rng(config.seed)
        self._odometer = Odometer(rng, config.odometer, self._floor_config, reach=config.reach)
        stamps = []
        of = f" of {recording.info.frames}" if recording.info.frames else ""
        for frame in recording.frames():
            image = self.sources.for_odometry(frame)
            if image is None:
                continue
            step = self._odometer.track_images(image.depth, image.rgb, image.sensor)
            stamps.append(frame.stamp_s)
            self._look_for_floor(frame)
            say(f"trajectory: frame {len(stamps)}{of}, {step.state}")
        poses, self._solution = self._odometer.trajectory() if stamps else ([], None)
        states = self._odometer.states
        found = [state not in (LOST, RESTARTED) for state in states]
        self._poses = {s: p for s, p, known in zip(stamps, poses, found, strict=True) if known}
        self.lost = len(found) - sum(found)
        self.doubtful = states.count("doubtful")
        if self._odometer.back_end is not None:
            self.closures = self._odometer.back_end.closures
        claims = self._odometer.uncertainty(self._solution)
        self._claims = (
            None
            if claims is None
            else PoseUncertainty(claims.from_start[found], claims.aligned[found])
        )
        self._stamps = stamps
        self._level(self._poses)

    def images(self) -> Iterator[PlacedImage]:
        """The images, one after the other."""
        order = {stamp: number for number, stamp in enumerate(self._poses)}
        for frame in self.recording.frames():
            pose = self._poses.get(frame.stamp_s)
            if pose is None:
                self.with_depth += self.sources.for_odometry(frame) is not None
                continue
            covariance = np.zeros((6, 6))
            if self._claims is not None:
                covariance = np.nan_to_num(self._claims.from_start[order[frame.stamp_s]])
            yield from self._of_camera(frame, pose, covariance)

    def write(self, folder: RunFolder) -> None:
        """Write trajectory.txt, its covariances, tracking.csv, and graph.g2o (in the axes of the odometry)."""
        odometer = self._odometer
        remark = write_tracking(
            folder,
            self._stamps,
            odometer.states,
            odometer.failures,
            odometer.config.alarm.threshold,
            odometer.bend.solve(),
            odometer.vergence.solve(),
        )
        self.remarks += [remark] if remark else []
        poses = {stamp: self.T_map_world @ pose for stamp, pose in self._poses.items()}
        write_poses(folder, "trajectory.txt", poses.items())
        if self._claims is not None:
            turned = PoseUncertainty(
                *(
                    np.array([turned_covariance(P, self.T_map_world.rotation) for P in claims])
                    for claims in (self._claims.from_start, self._claims.aligned)
                )
            )
            write_covariances(folder, list(poses), list(poses.values()), turned)
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
                floor = view.floor.moved(view.T_map_camera)
                pose = estimate.pose or Gaussian(np.zeros(3), np.zeros((3, 3)))
                T = view.T_map_camera
                yield PlacedImage(view.sensor, depth, rgb, T, pose, floor, frame.stamp_s)

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
