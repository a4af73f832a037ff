"""Walks over a scene of several levels: which settings go with them."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import TYPE_CHECKING

from perception.primitives.errors import ConfigError
from planning.planners.mission import ON_LEVELS

from ..config.schema import Config

if TYPE_CHECKING:
    from sim.scene import Scene

LEAST_RISER_M = 0.01  # ours: tops that differ by less are one level


def planned(config: Config, scene: Scene) -> Config:
    """The configuration with the planner of several levels where the scene has them.

    Raises:
        ConfigError: A setting does not go with such a walk.
    """
    mission = config.mission
    if not scene.ground and mission.planner != ON_LEVELS:
        return config
    if mission.planner not in (ON_LEVELS, "search"):
        raise ConfigError(
            f"scene {scene.name!r} has several levels, and planner {mission.planner!r} walks on one; "
            f"leave --planner out, or set it to {ON_LEVELS}"
        )
    refused = {
        "robot.body='dynamic' is not led over levels; set 'kinematic'": config.robot.body == "dynamic",
        "mission.wander needs a map of one floor; leave it out": mission.wander,
        "mission.headings_deg: it arrives with any heading; leave them out": bool(mission.headings_deg),
        "moving objects are not seen there; choose a scene without": bool(scene.moving_objects),
        "it needs a depth camera; choose --robot g1": not (config.robot.tof or _has_depth_camera(config)),
    }  # fmt: skip
    for problem, holds in refused.items():
        if holds:
            raise ConfigError(f"planner {ON_LEVELS!r}: {problem}")
    steps = config.robot_model.steps
    step_m = min(steps.up_m, steps.down_m)
    tops = sorted({0.0, *(round(part.top_m, 6) for part in scene.ground)})
    risers = [b - a for a, b in itertools.pairwise(tops) if b - a > LEAST_RISER_M]
    if not min(step_m, steps.reach_m) > 0.0 or (risers and min(risers) > step_m):
        needed = (
            f"; the scene {scene.name!r} has risers of {100 * min(risers):.0f} cm" if risers else ""
        )
        raise ConfigError(
            f"robot {config.robot.model!r} steps up and down {100 * step_m:.0f} cm and {100 * steps.reach_m:.0f} cm "
            f"ahead ([steps] of its description){needed}; choose --robot g1"
        )
    return replace(config, mission=replace(mission, planner=ON_LEVELS))


def _has_depth_camera(config: Config) -> bool:
    """Whether the description of the robot has one."""
    found = config.robot.described
    return found is not None and found.sensor("depth") is not None
