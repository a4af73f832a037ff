"""Fifteen walks for each avoidance motion of Kang 2013, from camera images to footsteps; the paper's table is lost.

Each arena requires one motion. A walk succeeds if the robot selects that motion first, reaches the goal and has no
contact; where no passage is wide enough, if it selects to stop and has no contact. Widths and gaps are drawn evenly over
each class, borders included; the recall of the motion is also reported by the distance to the nearest border.

Source: Kang 2013 (seed 004), Table 6 (lost); specification, section 8.
"""

from __future__ import annotations

import itertools
from dataclasses import replace

from planning.planners.mission import MissionConfig
from sim.scenes import catalogue
from sim.scenes.avoidance_scenes import MOTIONS, to_border_m

from ...config.presets import on_body
from ...config.schema import Config
from ...results.run_folder import RunFolder
from ..support.experiment import Experiment, Outcome, Say, Target
from ..support.walks import total_falls, walk_all

LIMIT_S, STOP_LIMIT_S = 200.0, 40.0  # ours: the longest passage, lateral at 3 cm/s, takes 150 s

BORDER_M = (0.0, 0.01, 0.02, 0.04, 1.0)  # ours: bins of the distance to the border of a class


def config_of(motion: str, seed: int, body: str = "kinematic") -> Config:
    """Configuration of a walk in the arena of a motion, with a body of the paper's size."""
    config = Config(scene=f"avoidance_{motion.lower()}", seed=seed)
    limit = STOP_LIMIT_S if motion == "ST" else LIMIT_S
    tall = replace(config.robot.dynamic, anatomy="tall")
    config = replace(
        config,
        robot=replace(config.robot, stereo=False, dynamic=tall),
        mission=MissionConfig(planner="avoidance", time_limit_s=limit),
    )
    return on_body(config, body)


def first_motion(folder: RunFolder, config: Config) -> dict[str, float]:
    """first_motion: index in `MOTIONS` of the first motion walked, -1 if none."""
    commands = folder.read_csv("commands.csv")
    reasons = [] if commands is None else commands.words("why")
    found = [MOTIONS.index(reason) for reason in reasons if reason in MOTIONS]
    return {"first_motion": float(found[0] if found else -1)}


def run(seeds: int, say: Say, body: str = "kinematic", motions: int = len(MOTIONS)) -> Outcome:
    """Seven arenas per seed, each walk about half a minute on a free core; `motions`: only the first of them."""
    todo = [(motion, seed) for motion in MOTIONS[:motions] for seed in range(seeds)]
    walked = walk_all([config_of(*one, body) for one in todo], say, first_motion)
    figures: dict[str, float] = {}
    table = ["motion  success  expected  arrived  contacts  falls  clearance"]
    successes: list[int] = []
    for motion in MOTIONS[:motions]:
        group = [m for (name, _), m in zip(todo, walked, strict=True) if name == motion]
        expected = [m["first_motion"] == MOTIONS.index(motion) for m in group]
        arrived = [m["goals_missed"] == 0 for m in group]
        clean = [m["contacts"] == 0 for m in group]
        complete = [motion == "ST" or there for there in arrived]
        good = sum(a and b and c for a, b, c in zip(expected, complete, clean, strict=True))
        successes.append(good)
        clearance = min(m["min_clearance_m"] for m in group)
        figures[f"success_{motion.lower()}"] = float(good)
        table.append(
            f"{motion:<6}  {good:3d}/{seeds:<3d}  {sum(expected):8d}  {sum(arrived):7d}"
            f"  {sum(m['contacts'] for m in group):8.0f}  {total_falls(group):5.0f}  {1e3 * clearance:6.0f} mm"
        )
    border = [to_border_m(catalogue.load(config_of(*one).scene, one[1]), one[0]) for one in todo]
    right = [
        m["first_motion"] == MOTIONS.index(motion)
        for m, (motion, _) in zip(walked, todo, strict=True)
    ]
    clean = [m["contacts"] == 0 for m in walked]
    table.append("to the border, cm  walks  recall  without contact")
    for low, high in itertools.pairwise(BORDER_M):
        near = [k for k, off in enumerate(border) if low <= off < high]
        if near:
            recall = sum(right[k] for k in near) / len(near)
            figures[f"recall_from_{100 * low:.0f}cm"] = recall
            table.append(
                f"from {100 * low:4.0f}         {len(near):6d}  {recall:6.2f}  {sum(clean[k] for k in near):6d}"
            )
    figures["walks_per_configuration"] = float(seeds)
    figures["success_min_of_15"] = 15.0 * min(successes) / seeds
    figures["success_pct"] = 100.0 * sum(successes) / len(todo)
    figures["contacts"] = float(sum(m["contacts"] for m in walked))
    figures["falls"] = total_falls(walked)
    return Outcome(figures, table)


EXPERIMENT = Experiment(
    id="004-E3",
    title="Fifteen walks for each avoidance motion, from camera images to footsteps (Kang 2013)",
    run=run,
    body="kinematic",
    targets={"success_min_of_15": Target("==", 15.0), "contacts": Target("==", 0.0)},
    seeds=15,
)
