"""A walk of ten metres through a furnished home, fast enough for a hundred of them.

Body, slip and depth camera are those of every simulated run. Two simplifications save time: the route is given instead
of planned, and tags are detected by geometry instead of in images (`support/tag_sensor.py`).

All processing that needs no pose happens here once, so that several localisers can process the same walk.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from perception.floor.segmented_view import SegmentedView
from perception.obstacles.track import Detection
from perception.primitives.frame import Frame
from perception.primitives.landmark import Sighting
from perception.primitives.pose import Pose2, wrap_angle
from planning.commands import GazeCommand, WalkCommand
from sim.body.head import HeadConfig
from sim.body.inertial import ImuConfig
from sim.body.kinematic import SlipConfig, SwayConfig
from sim.free_space import clearance_map
from sim.robot import SimulatedRobot
from sim.robot_config import RobotConfig
from sim.scene import Scene
from sim.scenes import catalogue
from sim.sensors.tof_camera import TofConfig
from sim.truth import FIRST_STATIC_ID, ObstacleTruth, Truth
from sim.world import World

from ...config.schema import Config
from ...run.pipeline import Pipeline
from ...run.simulate import known_beforehand
from ..support.tag_sensor import TagNoise, TagSensor

Noisy = TypeVar("Noisy", SlipConfig, SwayConfig, ImuConfig, HeadConfig, TofConfig, TagNoise)

LENGTH_M = 10.0
MAX_FRAMES = 900  # including waiting for moving obstacles
CLEARANCE_M = 0.28
STRIDE_M = 0.045  # cruise of 0.07 m/s
# pans of the head during the survey, as of the robot's gaze policy, and while walking
SURVEY_DEG = (0.0, 40.0, 80.0, 40.0, 0.0, -40.0, -80.0, -40.0)
GLANCES_DEG = (0.0, 40.0, 0.0, -40.0, 0.0, 80.0, 0.0, -80.0)
TILT_DEG = 28.0
LOOK_AHEAD_M = 0.30
WAIT_M = 0.55  # the robot waits for moving obstacles ahead within this distance


@dataclass(frozen=True)
class WalkInstant:
    """Measurements of one instant, processed as far as no pose is needed, and the truth.

    Args:
        frame: Odometry and inertial sensor, without images.
        sightings: Sightings of tags.
        views: Segmented depth image, body frame.
        detections: Detections of objects with a known centre, body frame.
        cut: Detections of objects that a border of the image cuts, body frame.
        pose: True pose.
        moving: True moving obstacles: identity, x, y, vx, vy, radius, height.
        fell: Whether the robot fell, which ends the walk.
    """

    frame: Frame
    sightings: list[Sighting]
    views: tuple[SegmentedView, ...]
    detections: list[Detection]
    cut: list[Detection]
    pose: Pose2
    moving: list[ObstacleTruth]
    fell: bool = False


def walk(
    seed: int, config: Config, noise: float = 1.0, length_m: float = LENGTH_M
) -> Iterator[WalkInstant]:
    """Survey the room, then follow a free path through it for ten metres, or until the robot falls.

    Args:
        seed: Seed of home, body and sensors.
        config: Configuration of perception and body; only the depth camera is on, with one ray per pixel.
        noise: Factor of the noise of body and sensors.
    """
    scene = catalogue.load("home", seed)
    robot = replace(config.robot, stereo=False, colour=False, tof_camera=TofConfig(sub_rays=1))
    robot, tag_noise = scaled_noise(robot, noise)
    rng = np.random.default_rng([seed, 50])
    with World(scene, "tiny", seed) as world, SimulatedRobot(world, robot, seed) as body:
        truth = Truth(body)
        tags = TagSensor(scene, tag_noise, config.landmarks, rng)
        guide = RouteFollower(scene)
        # never told of motion: its map stays the body frame
        own = replace(config, seed=seed)
        pipeline = Pipeline(own, replace(known_beforehand(scene, body, own), start=Pose2()))
        walked, before = 0.0, truth.robot_pose()
        for _ in range(MAX_FRAMES):
            frame = body.read()
            pose = truth.robot_pose()
            moving = [one for one in truth.obstacles() if one[0] < FIRST_STATIC_ID]
            if body.fallen:  # images of a fallen robot are not used
                blind = replace(frame, tof=None, colour=None, stereo=None)
                yield WalkInstant(blind, [], (), [], [], pose, moving, fell=True)
                return
            assert frame.tof is not None
            assert frame.tof.T_body_camera is not None
            sightings = []
            if frame.footstep_due:  # frame rate of the colour camera
                image = body.config.colour_camera
                true = body.camera_in_world(image.mount_m)
                sightings = tags.look(world.rays, image, true, frame.tof.T_body_camera)
            views = tuple(
                view
                for sensor, depth in pipeline.depth_sources.images(frame)
                if (view := pipeline.segment(sensor, depth)) is not None
            )
            _, detections, cut = pipeline.cluster(views, None)
            blind = replace(frame, tof=None, colour=None, stereo=None)
            yield WalkInstant(blind, sightings, views, detections, cut, pose, moving)
            walked += math.hypot(pose.x - before.x, pose.y - before.y)
            before = pose
            if walked >= length_m:
                return
            if frame.footstep_due:
                step, gaze = guide.next(pose, moving)
                body.walk(step)
                body.look(gaze)


def scaled_noise(robot: RobotConfig, factor: float) -> tuple[RobotConfig, TagNoise]:
    """The robot with every error of body and sensors times a factor, and the same of its tags."""
    slip, sway, imu, head, tof = robot.slip, robot.sway, robot.imu, robot.head, robot.tof_camera
    tags = TagNoise()
    return replace(
        robot,
        slip=_times(slip, factor, *vars(slip)),
        sway=_times(sway, factor, "roll_deg", "pitch_deg", "yaw_deg", "height_m"),
        imu=_times(imu, factor, *vars(imu)),
        head=_times(head, factor, "offset_deg"),
        tof_camera=_times(tof, factor, "noise_m", "floor_noise_m", "wiggling_m", "pattern_m"),
    ), _times(tags, factor, "corner_px", "grow_px", "lower_px")


def _times(config: Noisy, factor: float, *names: str) -> Noisy:
    """The same configuration with these numbers times a factor."""
    return replace(config, **{name: factor * getattr(config, name) for name in names})


class RouteFollower:
    """Gives the next step and gaze along a route, by the true pose."""

    def __init__(self, scene: Scene) -> None:
        space = clearance_map(
            scene.extent, [p for thing in scene.static_objects for p in thing.parts]
        )
        home = (scene.start.x, scene.start.y)
        legs, at, length = [], home, 0.0
        for stop in itertools.islice(itertools.cycle((*scene.goals, home)), 40):
            leg = None if stop == at else space.path(at, stop, CLEARANCE_M)
            if leg is not None:
                legs.append(leg)
                at, length = stop, length + math.dist(leg[0], leg[-1])
            if length > 1.2 * LENGTH_M:
                break
        self._route = np.concatenate(legs)
        self._next = 0
        self._steps = 0

    def next(self, pose: Pose2, moving: list[ObstacleTruth]) -> tuple[WalkCommand, GazeCommand]:
        """Next step and gaze at a pose among moving obstacles."""
        survey = self._steps < len(SURVEY_DEG)
        pans = SURVEY_DEG if survey else GLANCES_DEG
        gaze = GazeCommand(math.radians(pans[self._steps % len(pans)]), math.radians(TILT_DEG))
        self._steps += 1
        if survey or any(self._blocks_path(pose, x, y) for _, x, y, *_ in moving):
            return WalkCommand(), gaze
        while self._next < len(self._route) - 1:
            x, y = self._route[self._next]
            if math.hypot(x - pose.x, y - pose.y) > LOOK_AHEAD_M:
                break
            self._next += 1
        bearing = _bearing(pose, *self._route[self._next])
        most = math.radians(14.0)
        ahead = STRIDE_M * max(0.0, math.cos(bearing)) ** 2
        return WalkCommand(ahead, 0.0, 0.6 * min(max(bearing, -most), most)), gaze

    @staticmethod
    def _blocks_path(pose: Pose2, x: float, y: float) -> bool:
        near = math.hypot(x - pose.x, y - pose.y) < WAIT_M
        return near and abs(_bearing(pose, x, y)) < 1.2


def _bearing(pose: Pose2, x: float, y: float) -> float:
    return wrap_angle(math.atan2(y - pose.y, x - pose.x) - pose.yaw)
