"""Plots of four avoidance motions as in Fig. 9 (lateral slip, slip and walk, turn and slip, turn and walk), from above.

For each motion also the four panes of Fig. 6 at the start: camera image, range image, panorama, and free space with
the selected motion.

Source: Kang 2013 (seed 004), Figs. 6 and 9.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

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

SHOWN = ("SS", "SF", "RS", "RF")
INSTANTS = 12
PICTURES = Path("runs/experiments/004-E4")


def draw_sequence(folder: RunFolder, config: Config) -> dict[str, float]:
    """Plot the true path with the body at twelve instants; pictures: 1 if a plot was made."""
    from matplotlib.figure import Figure

    walked = folder.read_trajectory("truth/trajectory.txt")
    if walked is None:
        return {"pictures": 0.0}
    scene = catalogue.load(config.scene, config.seed)
    robot = config.robot_model
    half = np.array([robot.depth_m, robot.width_m]) / 2
    body = half * np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]])
    with style.styled():
        figure = Figure(figsize=(6.4, 5.4), layout="constrained")
        axes = figure.add_subplot()
        for thing in scene.obstacles:
            axes.fill(*outline(thing.parts[0]).T, color=style.FAINT)
        axes.plot(*walked.positions[:, :2].T, color=style.ESTIMATE)
        for k in np.linspace(0, len(walked.stamps) - 1, INSTANTS).astype(int):
            c, s = np.cos(walked.yaws[k]), np.sin(walked.yaws[k])
            corners = body @ np.array([[c, s], [-s, c]]) + walked.positions[k, :2]
            axes.fill(*corners.T, fill=False, color=style.TRUTH)
            axes.annotate(f"{walked.stamps[k] - walked.stamps[0]:.0f} s", corners[0], fontsize=7)
        axes.plot(*scene.goals[0], "*", color=style.TARGET)
        axes.set(aspect="equal", xlabel="x, m", ylabel="y, m", title=scene.name)
        style.save(figure, PICTURES / f"{scene.name}-{config.seed}.png")
    return {"pictures": 1.0}


def draw_panes(scene: Scene, config: Config) -> bool:
    """Plot the four panes at the start; returns whether the blocked path was detected."""
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
    figure = avoidance.four_panes(picture, views, panorama, around, choice)
    style.save(figure, PICTURES / f"{scene.name}-{config.seed}-panes.png")
    return choice is not None


def run(seeds: int, say: Say, body: str = "kinematic") -> Outcome:
    """Four walks and four panoramas per seed."""
    configs = [config_of(motion, seed, body) for motion in SHOWN for seed in range(seeds)]
    blocked = 0
    for config in configs:
        blocked += draw_panes(catalogue.load(config.scene, config.seed), config)
        say(f"four panes of {config.scene}")
    walked = walk_all(configs, say, draw_sequence)
    figures = {
        "sequences": float(sum(m["pictures"] for m in walked)),
        "panes": float(len(configs)),
        "blocked_share": blocked / len(configs),
        "contacts": float(sum(m["contacts"] for m in walked)),
        "falls": total_falls(walked),
    }
    return Outcome(figures, [f"plots: {PICTURES}"])


EXPERIMENT = Experiment(
    id="004-E4",
    title="Plots of four avoidance motions and of their perception (Kang 2013, Figs. 6 and 9)",
    run=run,
    body="kinematic",
    targets={"sequences": Target(">=", 4.0), "contacts": Target("==", 0.0)},
    seeds=1,
)
