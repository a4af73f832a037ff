"""Walks of seed 000's robot in its own worlds: configuration, and when which goal was reached by the truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from perception.primitives.robot_model import GaitLimits
from planning.planners.mission import MissionConfig
from sim.scenes import catalogue
from sim.scenes.seed_rooms import GOAL_TIMES_S

from ...config.presets import on_body
from ...config.schema import Config
from ...results.run_folder import RunFolder
from ..joint.people_home import falls_and_contacts

PRINTED_MPS = 0.04 / 0.65  # seed 000: S_F in T_SS + T_DS
REACHED_M = 0.15  # tolerance of 0.10 m by the estimate, and 5 cm that the estimate may be off


def config_of(
    scene: str,
    seed: int,
    limit_s: float,
    cruise_mps: float = GaitLimits().cruise_mps,
    body: str = "kinematic",
    version: str = "ours",
) -> Config:
    """The colour camera alone, two pictures a step, goals by the clock.

    Args:
        scene: "robots_room" or "narrow_course".
        seed: Of the world.
        limit_s: When the mission ends at the latest.
        cruise_mps: Walking speed; at the printed one nothing is ever faster.
        body: "kinematic" or "dynamic".
        version: Of the walker, see `SwarmWalkerConfig`.
    """
    config = Config(scene=scene, seed=seed)
    robot = replace(config.robot, tof=False, stereo=False, image_pairs=True)
    gait = replace(config.gait, cruise_mps=cruise_mps)
    if cruise_mps <= PRINTED_MPS:
        gait = replace(gait, max_speed_mps=cruise_mps)
    times = GOAL_TIMES_S[scene]
    config = replace(
        config,
        robot=robot,
        gait=gait,
        swarm=replace(config.swarm, goal_times_s=times, version=version),
        mission=MissionConfig(planner="swarm", goals=len(times), time_limit_s=limit_s),
    )
    return on_body(config, body)


def figures_of(folder: RunFolder, config: Config) -> dict[str, float]:
    """What became of every goal, footsteps, contacts by class; NaN where a goal did not hold yet.

    Returns:
        goal<k>_s (when it was reached while it held, NaN if it was not), goal<k>_approach_m (how much
        nearer it was when the next one held, or when it was reached), footsteps, falls, contacts_<class>.
    """
    figures = falls_and_contacts(folder, config)
    walked = folder.read_trajectory("truth/trajectory.txt")
    assert walked is not None, "a simulated run has its truth"
    goals = catalogue.load(config.scene, config.seed, config.difficulty).goals
    starts = config.swarm.goal_times_s
    for k, (goal, begin) in enumerate(zip(goals, starts, strict=True)):
        end = starts[k + 1] if k + 1 < len(starts) else np.inf
        held = (walked.stamps >= begin) & (walked.stamps < end)
        away = np.hypot(*(walked.positions[held, :2] - np.array(goal)).T)
        there = np.flatnonzero(away <= REACHED_M)
        reached = float(walked.stamps[held][there[0]]) if len(there) else np.nan
        figures[f"goal{k + 1}_s"] = reached
        last = there[0] if len(there) else -1
        figures[f"goal{k + 1}_approach_m"] = float(away[0] - away[last]) if len(away) else np.nan
    moved = np.hypot(*np.diff(walked.positions[:, :2], axis=0).T)
    step_s = config.gait.step_s
    figures["footsteps"] = float(np.ceil((walked.stamps[-1] - walked.stamps[0]) / step_s))
    figures["walked_m"] = float(moved.sum())
    return figures
