"""The gaze map over pan and tilt and the selected gaze, compared with brute force over every direction.

Every seed has obstacles with uncertain positions, a path point, and outdated cells on one or both sides. Brute force
tests for every direction and every point whether the camera sees it, sums eq. (5) and (6), and finds the highest
plateau by flood fill. The first seed is drawn: a top view with covariance ellipses, and the gaze map with theta*.

Source: Yoo and Kim 2010 (seed 001), section V-B, Fig. 7.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from perception.primitives.gaussian import Gaussian
from perception.primitives.pose import head_rotation
from planning.commands import GazeCommand
from planning.gaze import evaluations
from planning.gaze.selection import GazeMapConfig, gaze_map, highest_plateau

from ...report.plots.style import ESTIMATE, FAINT, TARGET, WRONG, Drawing, sheet
from ..support.experiment import Experiment, Outcome, Say, Target

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MAP_SAID = (
    "Left: the situation with covariance ellipses of the obstacles and their velocities; right: the gaze map over pan and "
    "tilt with the selected gaze."
)
EYE_M = 0.38
OBSTACLES = 5
STALE = 250


@dataclass(frozen=True)
class Situation:
    """Input of the gaze map: points relative to the camera in body axes, m, and evaluations psi."""

    obstacles: tuple[Gaussian, ...]
    velocities: Float[np.ndarray, "m 2"]
    stale: Float[np.ndarray, "n 3"]
    path_point: Float[np.ndarray, "3"]
    psi_map: float
    psi_path: float
    psi_self: float
    psi_obstacles: Float[np.ndarray, "m"]
    present: GazeCommand

    @property
    def feet(self) -> Float[np.ndarray, "m 3"]:
        """Points of the obstacles on the floor."""
        return np.array([[*o.mean, -EYE_M] for o in self.obstacles])


def draw(seed: int, config: GazeMapConfig) -> Situation:
    """Obstacles ahead of the robot, some of them moving, and outdated cells to the sides."""
    rng = np.random.default_rng([seed, 63])
    limits = config.evaluation
    bearings = rng.uniform(-1.3, 1.3, OBSTACLES)
    away = rng.uniform(0.5, 1.6, OBSTACLES)
    obstacles, velocities = [], []
    for bearing, distance in zip(bearings, away, strict=True):
        turn, sigmas = rng.uniform(0, math.pi), rng.uniform(0.01, 0.08, 2)
        axes = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
        place = distance * np.array([math.cos(bearing), math.sin(bearing)])
        obstacles.append(Gaussian(place, axes @ np.diag(sigmas**2) @ axes.T))
        speed, heading = rng.choice([0.0, 0.06, 0.12]), rng.uniform(-math.pi, math.pi)
        velocities.append([speed * math.cos(heading), speed * math.sin(heading)])
    places, moved = np.array([o.mean for o in obstacles]), np.array(velocities)
    psi = evaluations.of_obstacles(
        places, moved, np.array([o.covariance for o in obstacles]), limits
    )
    radius, off = rng.uniform(limits.nearest_m, limits.farthest_m, STALE), rng.normal(0, 0.3, STALE)
    sides = np.where(rng.uniform(size=STALE) < rng.uniform(0.2, 0.8), 0.9, -0.9)
    bearing = np.clip(sides + off, -1.55, 1.55)
    stale = np.column_stack(
        [radius * np.cos(bearing), radius * np.sin(bearing), np.full(STALE, -EYE_M)]
    )
    own = np.diag([rng.uniform(0.01, 0.06) ** 2] * 2 + [0.01**2])
    return Situation(
        tuple(obstacles),
        moved,
        stale,
        np.array([rng.uniform(0.8, 1.5), rng.uniform(-0.6, 0.6), -EYE_M]),
        evaluations.of_map(STALE, round(rng.uniform(100, 600))),
        evaluations.of_way(places, np.full(OBSTACLES, 0.25), limits),
        evaluations.of_self(own, limits),
        psi,
        GazeCommand(float(rng.uniform(-0.5, 0.5)), 0.5),
    )


def map_by_planner(
    situation: Situation, config: GazeMapConfig
) -> Float[np.ndarray, "rows columns"]:
    """Gaze map by the product."""
    return gaze_map(
        *(situation.psi_map, situation.stale, situation.psi_path, situation.path_point),
        *(situation.psi_self, situation.psi_obstacles, situation.feet, config),
    )


def map_by_brute_force(
    situation: Situation, config: GazeMapConfig
) -> Float[np.ndarray, "rows columns"]:
    """Gaze map by eq. (5) and (6), for each direction and point on its own."""
    across, down = (math.tan(math.radians(a) / 2) for a in (config.across_deg, config.down_deg))

    def sees(place: np.ndarray, axes: np.ndarray) -> bool:
        right, below, ahead = (float(v) for v in axes.T @ place)
        return ahead > 0.0 and abs(right) <= across * ahead and abs(below) <= down * ahead

    total = np.zeros((len(config.pans), len(config.tilts)))
    counts = np.zeros_like(total)
    share = 1.0 / len(situation.obstacles)
    for i, pan in enumerate(config.pans):
        for j, tilt in enumerate(config.tilts):
            axes = head_rotation(float(pan), float(tilt))
            counts[i, j] = sum(sees(place, axes) for place in situation.stale)
            if sees(situation.path_point, axes):
                total[i, j] += config.way_weight * situation.psi_path
            for place, psi in zip(situation.feet, situation.psi_obstacles, strict=True):
                if sees(place, axes):
                    total[i, j] += share * config.obstacle_weight * psi
                    total[i, j] += share * config.self_weight * situation.psi_self
    return total + config.map_weight * situation.psi_map * counts / max(counts.max(), 1.0)


def plateau_by_flood_fill(
    total: Float[np.ndarray, "rows columns"], present: GazeCommand, config: GazeMapConfig
) -> GazeCommand:
    """Centre of the highest plateau by flood fill; of several, the nearest to the present gaze."""
    left = {(int(i), int(j)) for i, j in np.argwhere(total >= total.max() - 1e-9)}
    middles = []
    for seed in sorted(left):
        if seed not in left:
            continue
        left.remove(seed)
        region, edge = [seed], [seed]
        while edge:
            i, j = edge.pop()
            near = sorted({(i + a, j + b) for a in (-1, 0, 1) for b in (-1, 0, 1)} & left)
            left.difference_update(near)
            region += near
            edge += near
        row, column = np.mean(region, axis=0)
        step = math.radians(config.step_deg)
        middles.append((config.pans[0] + row * step, config.tilts[0] + column * step))
    pan, tilt = min(
        middles, key=lambda m: math.hypot(m[0] - present.pan_rad, m[1] - present.tilt_rad)
    )
    return GazeCommand(float(pan), float(tilt))


def plot(
    situation: Situation, total: np.ndarray, chosen: GazeCommand, config: GazeMapConfig
) -> Figure:
    """Top view with 95 % covariance ellipses, and the gaze map."""
    from matplotlib.patches import Ellipse, Wedge

    figure, axes = sheet(1, 2, height_in=4.2, width_ratios=(1.0, 1.15))
    above, surface = axes
    view = math.degrees(chosen.pan_rad)
    half = config.across_deg / 2
    above.add_patch(
        Wedge((0, 0), 2.0, view - half + 90, view + half + 90, color=TARGET, alpha=0.15)
    )
    above.plot(-situation.stale[:, 1], situation.stale[:, 0], ".", color=FAINT, markersize=3)
    for obstacle, velocity in zip(situation.obstacles, situation.velocities, strict=True):
        long, short, turn = obstacle.ellipse()
        at = (-obstacle.mean[1], obstacle.mean[0])
        above.add_patch(
            Ellipse(
                at,
                2 * long,
                2 * short,
                angle=math.degrees(turn) + 90,
                color=ESTIMATE,
                alpha=0.4,
            )
        )
        above.plot(*at, "o", color=WRONG, markersize=4)
        above.annotate(
            "",
            xy=(at[0] - 5 * velocity[1], at[1] + 5 * velocity[0]),
            xytext=at,
            arrowprops={"arrowstyle": "-|>", "color": WRONG},
        )
    above.plot(-situation.path_point[1], situation.path_point[0], "*", color=TARGET, markersize=11)
    above.plot(0, 0, "^", color="black", markersize=8)
    above.set(
        title="top view, selected field of view in green",
        aspect="equal", xlabel="to the right, m", ylabel="ahead, m",
        xlim=(-1.9, 1.9), ylim=(-0.3, 2.1),
    )  # fmt: skip
    pans, tilts = np.degrees(config.pans), np.degrees(config.tilts)
    shown = surface.pcolormesh(pans, tilts, total.T, cmap="cividis", shading="nearest")
    figure.colorbar(shown, ax=surface, label="GM")
    surface.plot(
        math.degrees(chosen.pan_rad), math.degrees(chosen.tilt_rad), "o",
        markerfacecolor="none", markeredgecolor=WRONG, markersize=11, markeredgewidth=2,
    )  # fmt: skip
    surface.invert_xaxis()
    surface.invert_yaxis()
    surface.set(
        title="gaze map; ring: theta*", xlabel="pan, deg (left positive)", ylabel="tilt, deg"
    )
    return figure


def run(seeds: int, say: Say) -> Outcome:
    """About three seconds per seed, mostly brute force."""
    config = replace(GazeMapConfig(), across_deg=60.0, down_deg=45.0)  # seed 001's camera
    off, equal, apart = [], [], []
    table = ["seed  pan deg  tilt deg  directions that differ  equal to brute force"]
    for seed in range(seeds):
        situation = draw(seed, config)
        total, forced = map_by_planner(situation, config), map_by_brute_force(situation, config)
        chosen = highest_plateau(total, situation.present, config)
        wanted = plateau_by_flood_fill(forced, situation.present, config)
        off.append(float(np.mean(~np.isclose(total, forced, atol=1e-9))))
        apart.append(
            math.degrees(
                math.hypot(chosen.pan_rad - wanted.pan_rad, chosen.tilt_rad - wanted.tilt_rad)
            )
        )
        equal.append(apart[-1] < 1e-6)
        if seed == 0:
            gaze = Drawing("gaze-map", MAP_SAID, partial(plot, situation, total, chosen, config))
        table.append(
            f"{seed:4d}  {math.degrees(chosen.pan_rad):7.1f}  {math.degrees(chosen.tilt_rad):8.1f}"
            f"  {off[-1]:22.5f}  {equal[-1]}"
        )
        say(table[-1])
    figures = {
        "chosen_equal_share": float(np.mean(equal)),
        "chosen_apart_deg": max(apart),
        "directions_that_differ_share": float(np.mean(off)),
    }
    return Outcome(figures, table, drawings=[gaze])


EXPERIMENT = Experiment(
    id="001-E2",
    title="Gaze map and selected gaze equal brute force over every direction (Yoo and Kim 2010)",
    run=run,
    targets={
        "chosen_equal_share": Target("==", 1.0),
        "directions_that_differ_share": Target("<=", 1e-4),
    },
    seeds=20,
)
