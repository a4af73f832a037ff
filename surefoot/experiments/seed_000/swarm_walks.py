"""Walks of Han 2018's robot in its own worlds: configuration, and the time at which the true trajectory reaches each goal.

Source: Han 2018 (seed 000).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from perception.primitives.robot_model import GaitLimits

from ...config.presets import by_one_camera, on_body
from ...config.schema import Config
from ...results.run_folder import RunFolder
from ...run.simulate import scene_of
from ..support.walks import falls_and_contacts

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
    """Configuration with the colour camera alone, two images per step, and goals that change with time.

    Args:
        scene: "robots_room", "printed_room" or "narrow_course".
        seed: Seed of the world.
        limit_s: Time limit of the mission.
        cruise_mps: Walking speed; at `PRINTED_MPS` it is also the maximum speed.
        body: "kinematic" or "dynamic".
        version: Version of the swarm planner, see its settings.
    """
    config = by_one_camera(Config(scene=scene, seed=seed), scene)
    gait = replace(config.gait, cruise_mps=cruise_mps)
    if cruise_mps <= PRINTED_MPS:
        gait = replace(gait, max_speed_mps=cruise_mps)
    config = replace(
        config,
        gait=gait,
        swarm=replace(config.swarm, version=version),
        mission=replace(config.mission, planner="swarm", time_limit_s=limit_s),
    )
    return on_body(config, body)


def figures_of(folder: RunFolder, config: Config) -> dict[str, float]:
    """Goals, footsteps and contacts of a run.

    Returns:
        goal<k>_s (time at which goal k was reached while it was active, NaN if never), goal<k>_approach_m
        (distance gained on goal k while it was active), footsteps, walked_m, falls, contacts_<class>.
    """
    figures = falls_and_contacts(folder, config)
    walked = folder.read_trajectory("truth/trajectory.txt")
    assert walked is not None, "a simulated run has its truth"
    goals = scene_of(config).goals
    starts = config.swarm.goal_times_s
    for k, (goal, begin) in enumerate(zip(goals, starts, strict=True)):
        end = starts[k + 1] if k + 1 < len(starts) else np.inf
        active = (walked.stamps >= begin) & (walked.stamps < end)
        away = np.hypot(*(walked.positions[active, :2] - np.array(goal)).T)
        arrivals = np.flatnonzero(away <= REACHED_M)
        reached = float(walked.stamps[active][arrivals[0]]) if len(arrivals) else np.nan
        figures[f"goal{k + 1}_s"] = reached
        last = arrivals[0] if len(arrivals) else -1
        figures[f"goal{k + 1}_approach_m"] = float(away[0] - away[last]) if len(away) else np.nan
    moved = np.hypot(*np.diff(walked.positions[:, :2], axis=0).T)
    step_s = config.gait.step_s
    figures["footsteps"] = float(np.ceil((walked.stamps[-1] - walked.stamps[0]) / step_s))
    figures["walked_m"] = float(moved.sum())
    return figures


def compared(paper: dict[str, float], rows: dict[str, dict[str, float]]) -> list[str]:
    """Table of figures: the paper's value (- where it gives none), and a column for each walker."""
    first = next(iter(rows.values()))
    width = max(map(len, first))
    lines = [f"{'':{width}}" + "".join(f"  {name:>12}" for name in ("the paper's", *rows))]
    for key in first:
        told = f"{paper[key]:12.4g}" if key in paper else f"{'-':>12}"
        lines.append(f"{key:{width}}  {told}" + "".join(f"  {r[key]:12.4g}" for r in rows.values()))
    return lines
