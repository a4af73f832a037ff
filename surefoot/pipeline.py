"""The cycle: from one frame of the sensors to where we are, what is there, and what the map says.

It reads like the flow chart of seed 003, with the localiser and the tracks of seed 001 in front of the
map: locate, measure depth, find the floor, tell obstacles from it, follow what moves, remember. The same
cycle runs live and over a recording; deciding where to step is `navigator`'s part.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float, Int

from mapping.clouds import CloudBuilder
from mapping.confidence import ConfidenceLayer
from mapping.egocentric_grid import EgocentricGrid
from mapping.world_map import WorldMap
from perception import clusters, points, stereo, structured_light, time_of_flight
from perception.clusters import Cluster
from perception.floor import classify, find
from perception.levelling import level, shadow
from perception.localisation import landmarks
from perception.localisation.filter import PoseFilter, UpdateReport
from perception.localisation.obstacles import Detection, ObstacleTracker
from perception.points import Points
from perception.primitives.frame import ColourView, Depth, Frame
from perception.primitives.gaussian import Gaussian
from perception.primitives.obstacle import Obstacle
from perception.primitives.plane import Plane
from perception.primitives.pose import Pose2, Pose3

from .config import Config
from .recordings.recording import RecordingInfo
from .whereabouts import Given, Nowhere, Walker, Whereabouts


@dataclass(frozen=True)
class View:
    """One depth image, understood.

    Args:
        sensor: "tof", "stereo" or "depth".
        points: In the camera frame, m.
        classes: One of `classify`'s constants for each point.
        floor: The floor in the camera frame; the kinematic one where none was seen.
        seen: Share of the points on the floor; None where no floor was seen.
        T_map_camera: The camera in the upright map frame.
        upright: (n, 3) points in the map frame, z their height over the floor, m.
    """

    sensor: str
    depth: Depth
    points: Points
    classes: Int[np.ndarray, "n"]
    floor: Plane
    seen: float | None
    T_map_camera: Pose3
    upright: Float[np.ndarray, "n 3"]


@dataclass(frozen=True)
class Estimate:
    """What one cycle concluded.

    Args:
        stamp_s: Of the frame.
        pose: Gaussian over (x, y, yaw) of the body in the map frame; None for a camera in the hand
            without poses.
        views: The depth images, understood.
        clusters: Obstacles of this frame, body frame.
        obstacles: Tracks, map frame.
        landmarks: What the localiser made of the landmarks; None where none were looked for.
        timing_ms: Wall time of each stage.
    """

    stamp_s: float
    pose: Gaussian | None
    views: tuple[View, ...]
    clusters: tuple[Cluster, ...]
    obstacles: tuple[Obstacle, ...]
    landmarks: UpdateReport | None
    timing_ms: dict[str, float] = field(default_factory=dict)

    @property
    def pose2(self) -> Pose2:
        """Mean pose; the origin where there is none."""
        if self.pose is None:
            return Pose2()
        x, y, yaw = (float(v) for v in self.pose.mean)
        return Pose2(x, y, yaw)


class Stopwatch:
    """Wall time per stage of one cycle, ms."""

    def __init__(self) -> None:
        self.milliseconds: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Add the time of the block to a stage."""
        start = time.perf_counter()
        yield
        spent = 1e3 * (time.perf_counter() - start)
        self.milliseconds[name] = self.milliseconds.get(name, 0.0) + spent


class Pipeline:
    """Everything that lives from one frame to the next: whereabouts, tracks, maps, cloud."""

    def __init__(self, config: Config, info: RecordingInfo) -> None:
        self.config = config
        self.landmarks = info.landmarks
        self.whereabouts = _whereabouts(config, info)
        self.tracker = ObstacleTracker(config.tracker)
        self.rng = np.random.default_rng(config.seed)
        self.cloud = CloudBuilder(config.cloud)
        self.obstacle_cloud = CloudBuilder(config.obstacle_cloud)
        self._forget()

    def _forget(self) -> None:
        """Start the maps anew."""
        self.world = WorldMap(self.config.world_map)
        self.grid: EgocentricGrid | None = None
        self.confidence: ConfidenceLayer | None = None
        self._mapped_s: float | None = None

    def cycle(self, frame: Frame) -> Estimate:
        """Take one frame all the way from pixels to the map."""
        watch = Stopwatch()
        with watch.stage("locate"):
            sightings = (
                landmarks.detect(frame.colour, self.landmarks, self.config.landmarks)
                if frame.colour is not None and self.landmarks
                else []
            )
            report = self.whereabouts.update(frame, sightings)
        views = []
        for sensor, depth in self._depths(frame, watch):
            with watch.stage("floor"):
                view = self._understand(sensor, depth)
            if view is not None:
                views.append(view)
        pose = self.whereabouts.pose
        with watch.stage("obstacles"):
            found = self._cluster(views, pose)
            if pose is not None:
                self.tracker.update(
                    frame.stamp_s, [_detection(c) for c in found], pose, _visibility(views)
                )
        with watch.stage("map"):
            self._remember(frame, views, pose)
        return Estimate(
            frame.stamp_s,
            pose,
            tuple(views),
            tuple(found),
            tuple(self.tracker.obstacles) if pose is not None else (),
            report,
            watch.milliseconds,
        )

    def _depths(self, frame: Frame, watch: Stopwatch) -> Iterator[tuple[str, Depth]]:
        """Every depth image of the frame, whatever sensor it comes from."""
        with watch.stage("depth"):
            tof = None if frame.tof is None else time_of_flight.depth(frame.tof, self.config.tof)
        if tof is not None:
            yield "tof", tof
        if frame.depth is not None:
            yield "depth", structured_light.depth(frame.depth, self.config.structured_light)
        if frame.stereo is not None:
            with watch.stage("stereo"):
                pair = stereo.depth(frame.stereo, self.config.stereo)
            yield "stereo", pair

    def _understand(self, sensor: str, depth: Depth) -> View | None:
        """Points, floor and classes of one depth image; None where there is nothing to stand on."""
        reach = self.config.reach[sensor]
        cloud = points.from_depth(depth, reach.nearest_m, reach.farthest_m, reach.stride)
        expected = self.whereabouts.expected_floor(depth.T_body_camera)
        floor = find(cloud, expected, self.rng, self.config.floor)
        placed = self.whereabouts.place(depth.T_body_camera, None if floor is None else floor.plane)
        if placed is None:
            return None
        upright = placed.T_map_camera.apply(cloud.xyz)
        upright[:, 2] = placed.floor.distance(cloud.xyz)
        return View(
            sensor,
            depth,
            cloud,
            classify.classify(cloud, placed.floor, self.config.classes),
            placed.floor,
            None if floor is None else floor.share,
            placed.T_map_camera,
            upright,
        )
