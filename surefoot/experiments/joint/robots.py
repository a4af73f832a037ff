"""Humanoids of other makers in the furnished home, with their own legs, cameras and gaze joints, kinematically.

Every model of `sim.robots` that is installed walks to the first goal of homes that are as many times wider as the robot is
broader. Its cameras see its arms and legs. A point of a depth image counts as one of the robot itself if any ray of its
pixel met one of its links; a cell, a cluster or a track needs such points, so without any of them there is none of the
robot's own. What lasts in a run counts as one draw, so the band of the mean NEES is that of as many samples as runs.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from perception.filtering.consistency import band
from perception.primitives.errors import InputError
from planning.planners.mission import MissionConfig
from sim.robot_config import RobotConfig
from sim.robots import catalogue, installed

from ...config.presets import fitted
from ...config.schema import Config
from ...results.run_folder import RunFolder
from ..support.experiment import Experiment, Outcome, Say, Target
from ..support.walks import column, walk_all


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


def run(seeds: int, say: Say, limit_s: float = MissionConfig.time_limit_s) -> Outcome:
    """Seeds 0 to n - 1 for every robot, each walk at most `limit_s` long.

    Raises:
        InputError: No model is installed.
    """
    names = there()
    mission = MissionConfig(time_limit_s=limit_s)
    configs = [
        fitted(Config(scene="home", seed=seed, mission=mission, robot=RobotConfig(model=name)))
        for name in names
        for seed in range(seeds)
    ]
    found = walk_all(configs, say, own_points)
    low, high = band(3, seeds)
    figures: dict[str, float] = {}
    table = [
        "robot   walks  arrived  contacts  clearance  rmse cm   deg   NEES  own px  own used  speed m/s"
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
            "position_rmse_m": float(np.sqrt(np.mean(all_of("position_rmse_m") ** 2))),
            "heading_rmse_deg": float(np.sqrt(np.mean(all_of("heading_rmse_deg") ** 2))),
            "min_clearance_m": float(np.min(all_of("min_clearance_m"))),
            "speed_mps": float(np.sum(all_of("path_m")) / np.sum(all_of("duration_s"))),
        }
        figures |= {f"{name}_{key}": value for key, value in of_this.items()}
        table.append(
            f"{name:<6}  {seeds:5d}  {of_this['arrived_share']:7.2f}  {of_this['contacts']:8.0f}"
            f"  {1e3 * of_this['min_clearance_m']:6.0f} mm  {100 * of_this['position_rmse_m']:7.2f}"
            f"  {of_this['heading_rmse_deg']:4.2f}  {nees:5.2f}  {of_this['own_pixels']:6.0f}"
            f"  {of_this['own_cells']:8.0f}  {of_this['speed_mps']:9.2f}"
        )
    for key, worst in (("arrived_share", min), ("contacts", max), ("own_cells", max)):
        figures[key] = worst(figures[f"{name}_{key}"] for name in names)
    figures["anees_pose_in_band"] = min(figures[f"{name}_anees_pose_in_band"] for name in names)
    table.append(f"95 % band of the mean NEES over {seeds} runs: {low:.2f} to {high:.2f}")
    return Outcome(figures, table)


EXPERIMENT = Experiment(
    id="robots",
    title="Humanoids of other makers in the furnished home",
    run=run,
    targets={
        "arrived_share": Target("==", 1.0),
        "contacts": Target("==", 0.0),
        "anees_pose_in_band": Target("==", 1.0),
        "own_cells": Target("==", 0.0),
    },
)
