"""Humanoids of other makers in the furnished home, with their own legs, cameras and gaze joints.

Every model of `sim.robots` that is installed walks to the first goal of homes that are as many times wider as the robot is
broader. Its cameras see its arms and legs. A point of a depth image counts as one of the robot itself if any ray of its
pixel met one of its links; a cell, a cluster or a track needs such points, so without any of them there is none of the
robot's own. With the dynamic body they walk open loop besides (`humanoid_walks`), over flat floors and over bumps. What lasts in a run counts as one draw, so the band of the mean NEES is that of as many samples as runs.
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from perception.filtering.consistency import band
from perception.primitives.errors import InputError
from planning.planners.mission import MissionConfig
from sim.robot_config import RobotConfig
from sim.robots import catalogue, installed

from ...config.presets import on_body
from ...config.schema import Config
from ...evaluation.metrics.averages import rms
from ...results.run_folder import RunFolder
from ..support.experiment import Experiment, Outcome, Say, Target
from ..support.trials import run_all
from ..support.walks import column, walk_all
from .humanoid_walks import BUMPS_M
from .humanoid_walks import walk as humanoid_walk

SMALL_M = 0.002  # bumps over which no robot may fall


def own_points(folder: RunFolder, config: Config) -> dict[str, float]:
    """Pixels that showed the robot itself, and how many of them were used as points of the world."""
    table = folder.read_csv("truth/own_body.csv")
    if table is None:
        return {"own_pixels": float("nan"), "own_cells": float("nan")}
    return {
        "own_pixels": float(table.numbers("pixels").sum()),
        "own_cells": float(table.numbers("points").sum()),
    }


def there() -> list[str]:
    """The described robots whose URDF is installed.

    Raises:
        InputError: There is none.
    """
    found = [
        name
        for name in catalogue.names()
        if installed.folder(catalogue.load(name).package) is not None
    ]
    if not found:
        raise InputError(f"no robot model is installed; run: {installed.EXTRA}")
    return found


def figures_of(folder: RunFolder, config: Config) -> dict[str, float]:
    """Pixels of the robot itself, and whether it fell."""
    summary = folder.read_json("summary.json") or {}
    return own_points(folder, config) | {"falls": float(summary.get("fell_at_s") is not None)}


def open_loop(names: list[str], seeds: int, say: Say) -> tuple[dict[str, float], list[str]]:
    """Falls of every robot in open-loop missions over each kind of floor: figures, and lines of a table."""
    todo = [(name, bump, seed) for name in names for bump in BUMPS_M for seed in range(seeds)]
    found = run_all(humanoid_walk, todo, say, "missions")
    figures, lines = (
        {},
        ["robot   bumps  missions  falls  x real time  step error mm ahead, aside, deg"],
    )
    for name in names:
        for bump in BUMPS_M:
            walks = [
                one for one, (n, b, _) in zip(found, todo, strict=True) if (n, b) == (name, bump)
            ]
            falls = sum(one.fallen for one in walks)
            errors = np.concatenate([one.errors for one in walks])
            x, y, yaw = np.sqrt(np.mean(errors**2, axis=0)).tolist()
            factor = float(np.median([one.realtime_factor for one in walks]))
            figures[f"{name}_falls_{1e3 * bump:.0f}mm"] = float(falls)
            figures[f"{name}_realtime_{1e3 * bump:.0f}mm"] = factor
            lines.append(
                f"{name:<6} {1e3 * bump:3.0f} mm  {len(walks):8d}  {falls:5d}  {factor:11.1f}"
                f"  {1e3 * x:5.1f}  {1e3 * y:5.1f}  {math.degrees(yaw):4.2f}"
            )
    return figures, lines


def run(
    seeds: int,
    say: Say,
    body: str = "kinematic",
    limit_s: float = MissionConfig.time_limit_s,
) -> Outcome:
    """Seeds 0 to n - 1 for every robot, each walk at most `limit_s` long.

    Raises:
        InputError: No model is installed.
    """
    names = there()
    mission = MissionConfig(time_limit_s=limit_s)
    configs = [
        on_body(
            Config(scene="home", seed=seed, mission=mission, robot=RobotConfig(model=name)), body
        )
        for name in names
        for seed in range(seeds)
    ]
    found = walk_all(configs, say, figures_of)
    low, high = band(3, seeds)
    figures: dict[str, float] = {}
    table = [
        "robot   walks  arrived  contacts  clearance  rmse cm   deg   NEES  own px  own used  speed m/s  falls"
    ]
    for number, name in enumerate(names):
        walks = found[number * seeds : (number + 1) * seeds]
        all_of = partial(column, walks)
        nees = float(np.mean(all_of("pose_anees")))
        of_this = {
            "arrived_share": float(np.mean(all_of("goals_missed") == 0)),
            "contacts": float(np.sum(all_of("contacts"))),
            "anees_pose": nees,
            "anees_pose_in_band": float(low <= nees <= high),
            "own_cells": float(np.sum(all_of("own_cells"))),
            "own_pixels": float(np.sum(all_of("own_pixels"))),
            "position_rmse_m": rms(all_of("position_rmse_m")),
            "heading_rmse_deg": rms(all_of("heading_rmse_deg")),
            "min_clearance_m": float(np.min(all_of("min_clearance_m"))),
            "falls": float(np.sum(all_of("falls"))),
            "speed_mps": float(np.sum(all_of("path_m")) / np.sum(all_of("duration_s"))),
        }
        figures |= {f"{name}_{key}": value for key, value in of_this.items()}
        table.append(
            f"{name:<6}  {seeds:5d}  {of_this['arrived_share']:7.2f}  {of_this['contacts']:8.0f}"
            f"  {1e3 * of_this['min_clearance_m']:6.0f} mm  {100 * of_this['position_rmse_m']:7.2f}"
            f"  {of_this['heading_rmse_deg']:4.2f}  {nees:5.2f}  {of_this['own_pixels']:6.0f}"
            f"  {of_this['own_cells']:8.0f}  {of_this['speed_mps']:9.2f}  {of_this['falls']:5.0f}"
        )
    for key, worst in (("arrived_share", min), ("contacts", max), ("own_cells", max)):
        figures[key] = worst(figures[f"{name}_{key}"] for name in names)
    figures["anees_pose_in_band"] = min(figures[f"{name}_anees_pose_in_band"] for name in names)
    figures["falls"] = sum(figures[f"{name}_falls"] for name in names)
    table.append(f"95 % band of the mean NEES over {seeds} runs: {low:.2f} to {high:.2f}")
    if body == "dynamic":
        more, lines = open_loop(names, seeds, say)
        figures |= more
        figures["falls"] += sum(more[f"{name}_falls_{1e3 * SMALL_M:.0f}mm"] for name in names)
        table += ["", *lines]
    return Outcome(figures, table)


EXPERIMENT = Experiment(
    id="robots",
    title="Humanoids of other makers in the furnished home",
    run=run,
    body="kinematic",
    targets={
        "arrived_share": Target("==", 1.0),
        "contacts": Target("==", 0.0),
        "anees_pose_in_band": Target("==", 1.0),
        "own_cells": Target("==", 0.0),
        "falls": Target("==", 0.0),
    },
)
