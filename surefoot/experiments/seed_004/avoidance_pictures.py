"""Plots of four avoidance motions as in Fig. 9 (lateral slip, slip and walk, turn and slip, turn and walk), from above.

For each motion also the four panes of Fig. 6 at the start: camera image, range image, panorama, and free space with
the selected motion.

Source: Kang 2013 (seed 004), Figs. 6 and 9.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from mapping.panorama.sizes import surroundings
from mapping.panorama.stitching import stitch
from planning.avoidance.choice import choose
from planning.planners.panorama_obstacles import obstacle_table
from sim.robot import SimulatedRobot
from sim.scene import Scene
from sim.scenes import catalogue
from sim.shapes import outline
from sim.world import World

from ...config.schema import Config
from ...report.plots import avoidance, style
from ...results.run_folder import RunFolder
from ..support.experiment import Experiment, Outcome, Say, Target
from ..support.walks import total_falls, walk_all
from .avoidance_walks import config_of
from .panorama_scenes import nine_views

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SHOWN = ("SS", "SF", "RS", "RF")
INSTANTS = 12


def true_path(folder: RunFolder, config: Config) -> dict[str, Any]:
    """path: rows of stamp, x, y, yaw of the true poses of a walk."""
    walked = folder.read_trajectory("truth/trajectory.txt")
    assert walked is not None, "a simulated run has its truth"
    return {"path": np.column_stack([walked.stamps, walked.positions[:, :2], walked.yaws])}


def draw_sequence(config: Config, path: Float[np.ndarray, "n 4"]) -> Figure:
    """Plot the true path with the body at twelve instants."""
    from matplotlib.figure import Figure

    scene = catalogue.load(config.scene, config.seed)
    robot = config.robot_model
    half = np.array([robot.depth_m, robot.width_m]) / 2
    body = half * np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]])
    figure = Figure(figsize=(6.4, 5.4), layout="constrained")
    axes = figure.add_subplot()
    for thing in scene.obstacles:
        axes.fill(*outline(thing.parts[0]).T, color=style.FAINT)
    axes.plot(path[:, 1], path[:, 2], color=style.ESTIMATE)
    for k in np.linspace(0, len(path) - 1, INSTANTS).astype(int):
        stamp_s, x, y, yaw = path[k]
        c, s = np.cos(yaw), np.sin(yaw)
        corners = body @ np.array([[c, s], [-s, c]]) + (x, y)
        axes.fill(*corners.T, fill=False, color=style.TRUTH)
        axes.annotate(f"{stamp_s - path[0, 0]:.0f} s", corners[0], fontsize=7)
    axes.plot(*scene.goals[0], "*", color=style.TARGET)
    axes.set(aspect="equal", xlabel="x, m", ylabel="y, m", title=scene.name)
    return figure


def panes_at_start(scene: Scene, config: Config) -> tuple[Callable[[], Figure], bool]:
    """The four panes at the start as a drawing, and whether the blocked path was detected."""
    with (
        World(scene, config.renderer, config.seed) as world,
        SimulatedRobot(world, config.robot, config.seed) as robot,
    ):
        frame = robot.read()
        if frame.colour is None:  # one of the two frames of a step has an image
            frame = robot.read()
    rng = np.random.default_rng([config.seed, 92])
    views, _ = nine_views(scene, rng)
    panorama = stitch(views, rng)
    around = surroundings(panorama, views)
    choice = choose(obstacle_table(panorama, around), config.avoidance, config.robot_model)
    picture = None if frame.colour is None else frame.colour.rgb
    draw = partial(avoidance.four_panes, picture, views, panorama, around, choice)
    return draw, choice is not None


def run(seeds: int, say: Say, body: str = "kinematic", motions: int = len(SHOWN)) -> Outcome:
    """Four walks and four panoramas per seed; `motions`: only the first of them."""
    configs = [config_of(motion, seed, body) for motion in SHOWN[:motions] for seed in range(seeds)]
    blocked, panes = 0, []
    for config in configs:
        draw, seen = panes_at_start(catalogue.load(config.scene, config.seed), config)
        name = f"{config.scene}-{config.seed}"
        panes.append(style.Drawing(f"{name}-panes", f"The first scan of {name}.", draw))
        blocked += seen
        say(f"four panes of {config.scene}")
    walked = walk_all(configs, say, true_path)
    drawings = [
        style.Drawing(
            f"{config.scene}-{config.seed}",
            f"True path through {config.scene}, with the body at {INSTANTS} instants.",
            partial(draw_sequence, config, metrics["path"]),
        )
        for config, metrics in zip(configs, walked, strict=True)
    ]
    figures = {
        "sequences": float(sum(len(metrics["path"]) > 0 for metrics in walked)),
        "panes": float(len(configs)),
        "blocked_share": blocked / len(configs),
        "contacts": float(sum(m["contacts"] for m in walked)),
        "falls": total_falls(walked),
    }
    return Outcome(figures, drawings=[*drawings, *panes])


EXPERIMENT = Experiment(
    id="004-E4",
    title="Plots of four avoidance motions and of their perception (Kang 2013, Figs. 6 and 9)",
    run=run,
    body="kinematic",
    targets={"sequences": Target(">=", 4.0), "contacts": Target("==", 0.0)},
    seeds=1,
)
