"""What a body or a planner needs otherwise than the defaults have it."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

from perception.floor.classify import ClassConfig
from perception.localisation.landmarks import LandmarkConfig
from perception.localisation.localiser_noise import LocaliserConfig
from perception.primitives.robot_model import GaitLimits
from sim.robot import RobotConfig

from . import toml
from .robot_model import model_of
from .schema import Config

WALKED_LOCALISER = LocaliserConfig(
    slip_m=0.0014,
    slip_sigma_m=0.0006,
    lateral_slip_m=-0.0003,
    lateral_slip_sigma_m=0.0006,
    drift_sigma_rad=math.radians(0.25),
    step_x_sigma_m=0.0019,
    step_y_sigma_m=0.0015,
    step_yaw_sigma_rad=math.radians(1.4),
    still_sigma_m=0.003,
    still_sigma_rad=math.radians(4.0),
    shared_bearing_sigma_rad=math.radians(0.2),
)
"""What the odometry of the dynamic body needs: its steps come out a millimetre longer, turn and lead to one
side, left ones otherwise than right ones. Slip, lateral slip and steps are measured on 64 walks of 34 steps; deviations are
wider, for left and right differ. After a stop the soles settle by .4 deg, yet the standing deviation lets the gyro
follow a twist of ten degrees a second: taken for standing still, that would be taken for a bias of the gyro, and
mislead it for minutes."""


WALKED_LANDMARKS = LandmarkConfig(
    head_yaw_sigma_rad=math.radians(0.2),
    head_pitch_sigma_rad=math.radians(0.25),
    head_roll_sigma_rad=math.radians(0.35),
    camera_place_sigma_m=0.002,
)
"""How well the dynamic body knows where its camera is. With the defaults its walks were claimed too cautiously (NIS of
tags .5 of 2); with these, set on two recorded walks, it is .8 and 1.0."""


def needs(robot: RobotConfig) -> dict[str, Any]:
    """Values that differ from the defaults for this body, as nested tables.

    For the dynamic body the odometry of its steps and the sway of its cameras; for another anatomy or scale the
    height below which points are obstacles.
    """
    found: dict[str, Any] = {}
    if robot.body == "dynamic":
        found["localiser"] = _differing(WALKED_LOCALISER, LocaliserConfig())
        found["landmarks"] = _differing(WALKED_LANDMARKS, LandmarkConfig())
    height_m = model_of(robot, GaitLimits()).height_m
    if height_m != ClassConfig().robot_height_m:
        found["classes"] = {"robot_height_m": height_m}
    return found


def fitted(config: Config) -> Config:
    """The same with what its body needs, where nothing else was asked for."""
    return toml.changed(config, _unasked(needs(config.robot), config, Config()))


def _unasked(wanted: dict[str, Any], config: Any, plain: Any) -> dict[str, Any]:
    """Of nested values those that the configuration still has as the plain one."""
    found: dict[str, Any] = {}
    for name, value in wanted.items():
        have, default = getattr(config, name), getattr(plain, name)
        if isinstance(value, dict):
            found[name] = _unasked(value, have, default)
        elif have == default:
            found[name] = value
    return found


def _differing(one: Any, other: Any) -> dict[str, Any]:
    """Names and values of one dataclass where another of its kind has others."""
    return {name: value for name, value in vars(one).items() if value != getattr(other, name)}


def on_body(config: Config, body: str) -> Config:
    """The same walked by that body, "kinematic" or "dynamic", with what it needs."""
    return fitted(dataclasses.replace(config, robot=dataclasses.replace(config.robot, body=body)))


def by_one_camera(config: Config, scene: str) -> Config:
    """The same with what seed 000's walker has: one colour camera, two pictures a step, its worlds' goals by the clock.

    Source: seed 000, sections 2 and 6.5.1.
    """
    from sim.scenes.seed_rooms import GOAL_TIMES_S  # worlds are known to who walks in them

    times = GOAL_TIMES_S.get(scene, ())
    return dataclasses.replace(
        config,
        robot=dataclasses.replace(config.robot, tof=False, stereo=False, image_pairs=True),
        swarm=dataclasses.replace(config.swarm, goal_times_s=times),
        mission=dataclasses.replace(config.mission, goals=max(len(times), 1)),
    )
