"""Image pairs of a walk with the head tilted 30 deg down, for the experiments on one colour camera.

Source: Han 2018 (seed 000), section 2.1.1: one picture 0.2 s before the end of single support, one at its end.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from perception.monocular import pair_pose
from perception.monocular.result import Picture
from perception.primitives.frame import Frame
from perception.primitives.pose import Pose3
from planning.commands import GazeCommand, WalkCommand
from sim.rendering.rays import RayCaster
from sim.robot import SimulatedRobot
from sim.robot_config import RobotConfig
from sim.scenes import catalogue
from sim.truth import Truth
from sim.world import World

TILT_DEG = 30.0  # seed 000
ON_FLOOR_M = 1e-3

Moved = tuple[np.ndarray, float, np.ndarray]
"""Position and radius of a moving robot, m, and its displacement within the horizon."""


class Pair(NamedTuple):
    """Two images of a footstep.

    Args:
        given: With the simulator's camera poses.
        joints: With camera poses by the joints on the true body pose.
        sway_world: Tilt between them by the gyro, see `pair_pose.estimate`.
        truth: At the time of the second image.
    """

    given: tuple[Picture, Picture]
    joints: tuple[Picture, Picture]
    sway_world: np.ndarray | None
    truth: GroundTruth


class GroundTruth:
    """Truth at the time of the current image: moving robots, and the pixels that show the floor."""

    def __init__(self, robot: SimulatedRobot, image: Picture) -> None:
        world = robot.world
        self.moving_robots = world.moving_states()
        self.radii = [mover.radius_m for mover in world.scene.moving_objects]
        self.floor = true_floor(world.rays, image)

    def displacements(self, horizon_s: float) -> list[Moved]:
        """Position, radius and displacement within the horizon of every moving robot, at constant velocity."""
        return [
            (np.array([x, y]), radius, np.array([vx, vy]) * horizon_s)
            for (x, y, vx, vy), radius in zip(self.moving_robots, self.radii, strict=True)
        ]


def true_floor(rays: RayCaster, image: Picture) -> np.ndarray:
    """Pixels whose ray meets the floor first, by ray casting."""
    pose = image.T_world_camera
    directions = image.camera.rays.reshape(-1, 3) @ pose.rotation.T
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    hits = rays.cast(pose.position, directions.astype(np.float32))
    with np.errstate(invalid="ignore"):
        z = pose.position[2] + hits.distance_m * directions[:, 2]
    return np.asarray(z < ON_FLOOR_M).reshape(image.rgb.shape[:2])


def image_pairs(seed: int, cycles: int, scene: str = "robots_room") -> list[Pair]:
    """Image pairs of one walk."""
    rng = np.random.default_rng([seed, 60])
    found: list[Pair] = []
    with World(catalogue.load(scene, seed), seed=seed) as world:
        config = RobotConfig(tof=False, stereo=False, image_pairs=True)
        robot = SimulatedRobot(world, config, seed)
        truth = Truth(robot)
        robot.look(GazeCommand(0.0, math.radians(TILT_DEG)))
        robot.read(), robot.read()
        before = robot.read()
        old = _pictures(before, truth)
        turn = 0.0
        while len(found) < cycles:
            frame = robot.read()
            new = _pictures(frame, truth)
            if frame.footstep_due:
                given, joints = zip(old, new, strict=True)
                sway = _sway(before, frame, truth.robot_pose().yaw)
                found.append(Pair(given, joints, sway, GroundTruth(robot, new[0])))
                if len(found) % 3 == 1:
                    turn = float(rng.uniform(-10.0, 10.0))
                robot.walk(WalkCommand(0.04, 0.0, math.radians(turn), 0.30, 0.35))
            before, old = frame, new
    return found


def _pictures(frame: Frame, truth: Truth) -> tuple[Picture, Picture]:
    """The image with the simulator's camera pose, and with the joints' camera pose on the true body pose."""
    assert frame.colour is not None
    view = frame.colour
    assert view.T_body_camera is not None
    by_joints: Pose3 = truth.robot_pose().lifted() @ view.T_body_camera
    given, joints = (
        Picture(view.rgb, view.camera, pose, frame.stamp_s)
        for pose in (truth.camera_pose("colour"), by_joints)
    )
    return given, joints


def _sway(before: Frame, now: Frame, yaw_rad: float) -> np.ndarray | None:
    assert now.imu is not None
    assert before.colour is not None
    assert now.colour is not None
    old, new = before.colour.T_body_camera, now.colour.T_body_camera
    assert old is not None
    assert new is not None
    seconds = now.stamp_s - before.stamp_s
    return pair_pose.sway_by_gyro(now.imu.angular_velocity, seconds, old, new, yaw_rad)
