"""A walk among movers on a given route, seen by the pipeline through the time-of-flight camera.

Depth pictures, floor, clusters, localiser, tracks and maps are those of every run, so misses, false alarms, clutter and
the error of the pose are the chain's own. Two simplifications make it ten times faster than a whole run: tags are
detected by geometry (`tag_sensor`), and route and glances are given instead of planned, so that every
tracker gets the same detections.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from perception.localisation.filter import UpdateReport
from perception.localisation.pose_source import PlacedCamera, PoseSource
from perception.localisation.registration import RegistrationReport
from perception.localisation.static_points import StaticPoints
from perception.obstacles.record import Through
from perception.obstacles.track import Detection
from perception.obstacles.tracker import ObstacleTracker, TrackerConfig, Visible
from perception.primitives.frame import Frame
from perception.primitives.gaussian import Gaussian
from perception.primitives.landmark import Sighting
from perception.primitives.obstacle import Obstacle
from perception.primitives.plane import Plane
from perception.primitives.pose import Pose2, Pose3
from sim.robot import SimulatedRobot
from sim.sensors.tof_camera import TofConfig
from sim.truth import FIRST_STATIC_ID, ObstacleTruth, Truth
from sim.world import World

from ...config.schema import Config
from ...run.pipeline import Pipeline
from ...run.simulate import known_beforehand, scene_of, true_start
from ..joint.localisation_walk import RouteFollower
from .tag_sensor import TagNoise, TagSensor


@dataclass(frozen=True)
class Heard:
    """What a tracker was given in a frame; see `ObstacleTracker.update`."""

    detections: Sequence[Detection]
    robot: Gaussian
    visible: Visible


@dataclass(frozen=True)
class WatchedInstant:
    """One frame.

    Args:
        stamp_s: Its time.
        obstacles: Tracks of the product.
        heard: What they were made of; None without a view.
        pose: True pose of the robot.
        camera: True pose of the camera, world frame.
        truth: True obstacles, the moving ones first.
    """

    stamp_s: float
    obstacles: tuple[Obstacle, ...]
    heard: Heard | None
    pose: Pose2
    camera: Pose3
    truth: list[ObstacleTruth]


class _Listening(ObstacleTracker):
    """The tracker; it keeps what it was given last."""

    def __init__(self, config: TrackerConfig) -> None:
        super().__init__(config)
        self.heard: Heard | None = None

    def update(
        self,
        stamp_s: float,
        detections: Sequence[Detection],
        robot: Gaussian,
        visible: Visible | None = None,
        truncated: Sequence[Detection] = (),
        through: Through | None = None,
    ) -> None:
        assert visible is not None
        self.heard = Heard(detections, robot, visible)
        super().update(stamp_s, detections, robot, visible, truncated, through)


class _WithTags:
    """A pose source that is given tags by geometry."""

    def __init__(self, source: PoseSource, look: Callable[[Frame], list[Sighting]]) -> None:
        self._source, self._look = source, look

    @property
    def pose(self) -> Gaussian | None:
        return self._source.pose

    def update(self, frame: Frame, sightings: Sequence[Sighting]) -> UpdateReport | None:
        return self._source.update(frame, self._look(frame))

    def register(self, seen: Sequence[StaticPoints]) -> RegistrationReport | None:
        return self._source.register(seen)

    def expected_floor(self, T_body_camera: Pose3 | None) -> Plane:
        return self._source.expected_floor(T_body_camera)

    def place(self, T_body_camera: Pose3 | None, floor: Plane | None) -> PlacedCamera | None:
        return self._source.place(T_body_camera, floor)


def watched_walk(config: Config, seconds: float) -> Iterator[WatchedInstant]:
    """The frames of a walk.

    Args:
        config: Scene, seed, laws of the movers and the body; its cameras are replaced by the time-of-flight camera.
        seconds: Length of the walk; it ends earlier if the robot falls.
    """
    tof = TofConfig(sub_rays=1)
    blind = replace(config.robot, stereo=False, colour=False, tof_camera=tof)
    config = replace(config, robot=blind)
    scene = scene_of(config)
    placed = replace(scene, start=true_start(scene, config))
    tags = TagSensor(scene, TagNoise(), config.landmarks, np.random.default_rng([config.seed, 50]))
    with (
        World(placed, "tiny", config.seed) as world,
        SimulatedRobot(world, config.robot, config.seed) as robot,
    ):
        truth, image = Truth(robot), robot.config.colour_camera

        def look(frame: Frame) -> list[Sighting]:
            if not frame.footstep_due or frame.tof is None or frame.tof.T_body_camera is None:
                return []
            true = robot.camera_in_world(image.mount_m)
            return tags.look(world.rays, image, true, frame.tof.T_body_camera)

        pipeline = Pipeline(config, known_beforehand(scene, robot, config))
        pipeline.pose_source = _WithTags(pipeline.pose_source, look)
        tracker = pipeline.tracker = _Listening(config.tracker)
        guide = RouteFollower(scene)
        while world.stamp_s < seconds and not robot.fallen:
            frame = robot.read()
            tracker.heard = None
            found = pipeline.cycle(frame)
            pose, everything = truth.robot_pose(), truth.obstacles()
            camera = robot.camera_in_world(robot.config.tof_mount_m)
            yield WatchedInstant(
                frame.stamp_s, tuple(found.tracks), tracker.heard, pose, camera, everything
            )
            if frame.footstep_due:
                movers = [one for one in everything if one[0] < FIRST_STATIC_ID]
                step, gaze = guide.next(pose, movers)
                robot.walk(step)
                robot.look(gaze)
