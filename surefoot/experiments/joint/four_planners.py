"""Four planners on the same fifty scenes: field alone, search and field, swarm, and stop-and-avoid.

The scenes alternate between corridors with cartons and a robot, the room of seed 000 with three robots, boxes with a
gap, and furnished homes. All planners have the same body, gait and guard; the swarm planner uses the colour camera
alone, the others time of flight. A walk succeeds if it reaches the goal without contact. The table has a row per kind
of scene; a star marks the kinds that a planner's paper addresses. One plot per scene shows the four paths.

Source: specification, INT-4.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from perception.primitives import plugins
from planning.planners.factory import MEMBERS
from planning.planners.mission import PLANNERS, MissionConfig
from sim.shapes import outline

from ...config.presets import on_body
from ...config.schema import Config
from ...report.plots import style
from ...results.run_folder import RunFolder
from ...run.simulate import scene_of
from ..support.experiment import Experiment, Outcome, Say, Target
from ..support.trials import run_all
from ..support.walks import column, walk

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SCENES = ("corridor", "robots_room", "boxes", "home")
ORDER = ("field", "search", "swarm", "avoidance")
INTENDED_SCENES = {
    "field": ("robots_room",),  # seed 001: static or moving discs; concave obstacles trap the field
    "search": SCENES,  # seeds 003 and 001 together
    "swarm": ("corridor", "robots_room", "boxes"),  # seed 000: a floor of one colour
    "avoidance": ("corridor", "boxes"),  # seed 004: single obstacles with space to see them
}
"""The kinds of scene that each planner's paper addresses."""
LIMIT_S = 180.0  # ours: the longest path takes 95 s without any obstacle

WalkResult = tuple[dict[str, Any], np.ndarray]


def config_of(
    planner: str, number: int, body: str = "kinematic", limit_s: float = LIMIT_S
) -> Config:
    """Configuration of a walk with a planner, in the scene with this number."""
    scene, seed = SCENES[number % len(SCENES)], number // len(SCENES)
    config = Config(scene=scene, seed=seed)
    robot = replace(
        config.robot, stereo=False, tof=planner != "swarm", image_pairs=planner == "swarm"
    )
    mission = MissionConfig(planner=planner, goals=1, time_limit_s=limit_s)
    return on_body(replace(config, robot=robot, mission=mission), body)


def run(
    seeds: int, say: Say, body: str = "kinematic", own: str = "", limit_s: float = LIMIT_S
) -> Outcome:
    """Scenes 0 to n - 1 with every planner; four consecutive scenes are one of each kind.

    Args:
        seeds: Number of scenes.
        say: Takes lines of progress.
        body: Body that walks.
        own: The user's own planner, "package.module:Class", beside ours; empty: none.
        limit_s: Longest walk.
    """
    planners = [name for name in ORDER if name in PLANNERS]
    ours = len(planners)
    if own:
        plugins.load(own, PLANNERS, "planner", MEMBERS)  # refused before anything walks
        planners.append(own)
    todo = [config_of(name, k, body, limit_s) for k in range(seeds) for name in planners]
    found = run_all(_walk, [(config,) for config in todo], say, "walks")
    figures: dict[str, float] = {"scenes": float(seeds), "planners": float(ours)}
    more, table = compare(todo, [metrics for metrics, _ in found])
    table.append(
        "length, clearance (minimum of a walk), time, computing (perception and planning): medians"
    )
    each = len(planners)
    drawings = [
        style.Drawing(
            f"{number:02d}-{todo[k].scene}-{todo[k].seed}",
            f"Paths of the planners through {todo[k].scene} {todo[k].seed}.",
            partial(_draw, todo[k], planners, found[k : k + each]),
        )
        for number, k in enumerate(range(0, len(todo), each))
    ]
    return Outcome(figures | more, table, drawings=drawings)


def compare(
    configs: Sequence[Config], found: Sequence[dict[str, Any]]
) -> tuple[dict[str, float], list[str]]:
    """Figures and table rows by planner: over all scenes, over those of its paper, and by kind of scene.

    Args:
        configs: Configuration of each walk.
        found: Metrics of each walk.
    """
    figures: dict[str, float] = {}
    table = [
        "planner    scenes        walks  success  arrived  contact-free  length m  clearance mm"
        "   time s  computing s"
    ]
    for planner in dict.fromkeys((*ORDER, *(config.mission.planner for config in configs))):
        own = INTENDED_SCENES.get(planner, ())
        groups = {"all": SCENES, "own": own, **{kind: (kind,) for kind in SCENES}}
        for name, kinds in groups.items():
            walks = [
                metrics
                for config, metrics in zip(configs, found, strict=True)
                if config.mission.planner == planner and config.scene in kinds
            ]
            if not walks:
                continue
            row, shown = _figures(walks), plugins.label(planner)
            prefix = shown if name == "all" else f"{shown}_{name}"
            figures |= {f"{prefix}_{key}": value for key, value in row.items()}
            label = f"{name} *" if name in own or name == "own" else name
            table.append(_line(shown, label, row))
    return figures, table


def _line(planner: str, label: str, row: dict[str, float]) -> str:
    return (
        f"{planner:<10.10} {label:<13}{row['walks']:6.0f}{row['success_share']:9.2f}"
        f"{row['arrived_share']:9.2f}{row['contact_free_share']:14.2f}{row['length_m']:10.2f}"
        f"{row['clearance_mm']:14.0f}{row['time_s']:9.1f}{row['computing_s']:13.0f}"
    )


def _walk(config: Config) -> WalkResult:
    """Metrics and true path of one walk."""
    path: list[np.ndarray] = []

    def keep(folder: RunFolder, config: Config) -> dict[str, float]:
        walked = folder.read_trajectory("truth/trajectory.txt")
        if walked is not None:
            path.append(walked.positions[:, :2])
        return {"computing_s": computing_s(folder)}

    metrics = walk(config, keep)
    return metrics, path[0] if path else np.empty((0, 2))


def computing_s(folder: RunFolder) -> float:
    """Wall time of perception and planning over all frames of a run, s; NaN if the run has no timing.

    Rendering, body simulation, recording and report are not included.
    """
    times = folder.read_csv("timing.csv")
    if times is None:
        return math.nan
    stages = [name for name in times.columns if name != "stamp_s"]
    return float(np.nansum(times.matrix(*stages))) / 1e3 if stages else 0.0


def _figures(found: Sequence[dict[str, Any]]) -> dict[str, float]:
    all_of = partial(column, found)
    arrived, free = all_of("goals_missed") == 0, all_of("contacts") == 0
    return {
        "walks": float(len(found)),
        "success_share": float(np.mean(arrived & free)),
        "arrived_share": float(np.mean(arrived)),
        "contact_free_share": float(np.mean(free)),
        "length_m": float(np.median(all_of("path_m"))),
        "clearance_mm": 1e3 * float(np.median(all_of("min_clearance_m"))),
        "time_s": float(np.median(all_of("duration_s"))),
        "computing_s": float(np.median(all_of("computing_s"))),
    }


def _draw(config: Config, planners: Sequence[str], found: Sequence[WalkResult]) -> Figure:
    """Plot the scene from above with the paths of all planners."""
    scene = scene_of(config)
    x0, y0, x1, y1 = scene.extent
    figure, axes = style.sheet(height_in=1.0 + 7.0 * min((y1 - y0) / (x1 - x0), 1.2))
    for thing in scene.obstacles:
        for part in thing.parts:
            axes.fill(*outline(part).T, color=style.FAINT)
    for mover in scene.moving_objects:
        line = np.array([mover.start, mover.end])
        axes.plot(*line.T, color=style.WRONG, linewidth=4.0, alpha=0.35)
    for planner, colour, (metrics, path) in zip(planners, style.SERIES, found, strict=False):
        words = "arrived" if metrics.get("goals_missed") == 0 else "did not arrive"
        contacts = int(metrics.get("contacts", 0))
        axes.plot(
            *path.T,
            color=colour,
            label=f"{plugins.label(planner)}: {words}, contacts {contacts}",
        )
    axes.plot(*scene.goals[0], "*", color=style.TARGET, markersize=11)
    axes.plot(scene.start.x, scene.start.y, "o", color=style.INK)
    axes.set_xlim(x0, x1)
    axes.set_ylim(y0, y1)
    axes.set_aspect("equal")
    axes.set_xlabel("x, m")
    axes.set_ylabel("y, m")
    style.legend(axes, columns=2)
    return figure


EXPERIMENT = Experiment(
    id="INT-4",
    title="Four planners on the same scenes",
    run=run,
    body="kinematic",
    plug_in="planner",
    targets={
        "planners": Target("==", 4.0),
    },
    seeds=50,
)
