"""Presets: configurations that differ from the defaults for a body or a planner."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

from perception.floor.classify import ClassConfig
from perception.localisation.localiser_noise import LocaliserConfig
from perception.localisation.pose_source import PriorConfig
from perception.primitives.robot_model import GaitLimits
from sim.robot_config import RobotConfig

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
"""Step odometry of the dynamic body.

Its steps are 1 mm longer than commanded, and turn and drift to one side, differently for left and right. Slip, lateral
slip and step noise are measured on 64 walks of 34 steps; the standard deviations are increased because left and right
differ. After a stop the soles settle by 0.4 deg. The larger standard deviation while standing covers a rotation of
10 deg/s, which the filter would otherwise attribute to the gyro bias, with an effect for minutes."""


LONGER = 1.9  # ours: of a plausible step, relative to the longest one that is commanded; 1.9 for a DARwIn-OP too


def needs(robot: RobotConfig) -> dict[str, Any]:
    """Values that differ from the defaults for this body, as nested tables.

    For the dynamic body: step odometry, that of its description for a robot that has one. For another anatomy or scale: the height below which
    points are obstacles. For a robot that is described: its steps, and the field of view that the gaze aims.
    """
    found: dict[str, Any] = {}
    described = robot.described
    if robot.body == "dynamic":
        noise = WALKED_LOCALISER
        if described is not None and described.dynamic is not None:
            odometry: dict[str, Any] = dict(described.dynamic.odometry)
            noise = dataclasses.replace(noise, **odometry)
        found["localiser"] = _differing(noise, LocaliserConfig())
    height_m = model_of(robot, GaitLimits()).height_m
    if height_m != ClassConfig().robot_height_m:
        found["classes"] = {"robot_height_m": height_m}
    if described is not None:
        gait = described.model.gait
        if robot.body == "dynamic" and described.dynamic is not None:
            fastest = min(gait.max_speed_mps, described.dynamic.step_m / gait.step_s)
            gait = dataclasses.replace(
                gait, max_speed_mps=fastest, cruise_mps=min(gait.cruise_mps, fastest)
            )
        found["gait"] = vars(gait)
        longest_m = LONGER * gait.max_speed_mps * gait.step_s
        found["prior"] = {"longest_step_m": max(PriorConfig().longest_step_m, longest_m)}
        active = described.sensor("depth")
        sensor = described.sensor("tof") or active
        if sensor is not None:
            view = {"across_deg": sensor.across_deg, "down_deg": sensor.down_deg}
            found["gaze"] = {"map": view}
        if active is not None:
            focal_px = active.width / (2.0 * math.tan(math.radians(active.across_deg) / 2.0))
            growth = active.noise_px / (focal_px * active.baseline_m)
            found["structured_light"] = {"growth_per_m": growth, "start_m": 0.0}
    return found


def fitted(config: Config) -> Config:
    """The configuration with the values that its body needs, except where the user has changed them."""
    return toml.changed(config, _unchanged(needs(config.robot), config, Config()))


def _unchanged(wanted: dict[str, Any], config: Any, default: Any) -> dict[str, Any]:
    """The part of nested values for which a configuration still has the default."""
    found: dict[str, Any] = {}
    for name, value in wanted.items():
        current, initial = getattr(config, name), getattr(default, name)
        if isinstance(value, dict):
            found[name] = _unchanged(value, current, initial)
        elif current == initial:
            found[name] = value
    return found


def _differing(one: Any, other: Any) -> dict[str, Any]:
    """Names and values of the fields in which a dataclass differs from another of its type."""
    return {name: value for name, value in vars(one).items() if value != getattr(other, name)}


def on_body(config: Config, body: str) -> Config:
    """The configuration for that body, "kinematic" or "dynamic", with the values that it needs."""
    return fitted(dataclasses.replace(config, robot=dataclasses.replace(config.robot, body=body)))


def by_one_camera(config: Config, scene: str) -> Config:
    """The configuration of seed 000: one colour camera, two pictures per step, and goals with the times of its scenes.

    Source: seed 000, sections 2 and 6.5.1.
    """
    from sim.scenes.seed_rooms import GOAL_TIMES_S  # loaded only for simulation

    times = GOAL_TIMES_S.get(scene, ())
    return dataclasses.replace(
        config,
        robot=dataclasses.replace(config.robot, tof=False, stereo=False, image_pairs=True),
        swarm=dataclasses.replace(config.swarm, goal_times_s=times),
        mission=dataclasses.replace(config.mission, goals=max(len(times), 1)),
    )
