"""Streamlines of the univector field to a goal with an arrival angle, among obstacles, with two pairs of weights.

Streamlines start evenly spaced around the goal and must arrive with the desired heading. The published weights, which
lead deep into the obstacles, are compared with ours, and so are eq. (8) and (9) to the letter. Every seed has another
goal and other obstacles; seed 0, which is drawn, is the paper's figure, th_tg = pi/6.

Source: Yoo and Kim 2010 (seed 001), Fig. 3; specification, section 4 (weights).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from planning.univector import fields
from planning.univector.fields import PUBLISHED, FieldConfig

from ...evaluation.metrics.averages import mean
from ...report.plots.style import ESTIMATE, FAINT, TARGET, WRONG, Drawing, sheet
from ..support.experiment import Experiment, Outcome, Say, Target

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SIDE_M = 4.0  # of the plot
STARTS = 24  # evenly spaced along its edge
STEP_M = 0.005
AT_GOAL_M = 0.03
LONGEST_M = 60.0  # length limit; on the axis ahead of the goal the field turns away only slowly
OBSTACLES = 4
CLEAR_M = 1.3  # obstacle centre to goal: the last metre serves the arrival angle
ARROWS = 33
PORTRAIT_SAID = (
    "The field (arrows) and its streamlines (blue) from the edge to the goal with its arrival angle (green); extended "
    "radius S_oe of the obstacles in grey."
)
ROWS = (
    ("streamlines that arrive, share", 1.0, "arrived_share_printed", "arrived_share"),
    ("  eq. (8) and (9) to the letter", 1.0, "arrived_share_literal", ""),
    ("least distance by S_oe", None, "nearest_share_of_s_oe_printed", "nearest_share_of_s_oe"),
)


@dataclass(frozen=True)
class FieldWorld:
    """Goal and obstacles of one seed.

    Args:
        goal, heading: p_d, m, and th_tg, rad.
        centres, extended_m: Centres and extended radii S_oe of the obstacles, m.
    """

    goal: Float[np.ndarray, "2"]
    heading: float
    centres: Float[np.ndarray, "n 2"]
    extended_m: Float[np.ndarray, "n"]


def draw(seed: int) -> FieldWorld:
    """A goal near the centre with obstacles around it; seed 0 has the paper's arrival angle."""
    rng = np.random.default_rng([seed, 62])
    goal = rng.uniform(-0.3, 0.3, 2) if seed else np.zeros(2)
    heading = float(rng.uniform(-math.pi, math.pi)) if seed else math.pi / 6
    centres: list[np.ndarray] = []
    while len(centres) < OBSTACLES:
        place = rng.uniform(-SIDE_M / 2 + 0.6, SIDE_M / 2 - 0.6, 2)
        apart = min((np.hypot(*(place - other)) for other in centres), default=9.0)
        if np.hypot(*(place - goal)) >= CLEAR_M and apart >= 1.0:
            centres.append(place)
    extended = fields.extended_radius(
        np.full(OBSTACLES, 0.10), np.zeros(OBSTACLES), np.zeros(OBSTACLES), FieldConfig()
    )
    return FieldWorld(goal, heading, np.array(centres), extended)


def starts() -> Float[np.ndarray, "n 2"]:
    """Start points, evenly spaced along the edge of the plot, outside every obstacle."""
    along = (np.arange(STARTS) + 0.5) / STARTS * 4.0
    half, side = SIDE_M / 2, along.astype(int) % 4
    t = (along % 1.0 - 0.5) * SIDE_M
    edge = np.full(STARTS, half)
    x = np.choose(side, [t, edge, -t, -edge])
    y = np.choose(side, [-edge, t, edge, -t])
    return np.column_stack([x, y])


def streamlines(
    world: FieldWorld, config: FieldConfig, among: bool, literal: bool = False
) -> list[Float[np.ndarray, "n 2"]]:
    """Streamlines of the field from every start point to the goal.

    Args:
        world: Goal and obstacles.
        config: Weights.
        among: With the obstacles; else the move-to-goal field alone.
        literal: Eq. (8) and (9) as printed; the heading is that of the last step, at first to the goal.
    """
    here = starts()
    headings = np.arctan2(*(world.goal - here).T[::-1])
    lines = [[place.copy()] for place in here]
    moving = np.ones(len(here), dtype=bool)
    for _ in range(round(LONGEST_M / STEP_M)):
        if not moving.any():
            break
        goal = (here[moving], world.goal, world.heading)
        if among:
            discs = world.centres, world.extended_m
            u = fields.total(*goal, *discs, config, headings[moving], literal)
        else:
            u = fields.move_to_goal(*goal, config, headings[moving], literal)
        headings[moving] = np.arctan2(u[:, 1], u[:, 0])
        here[moving] += STEP_M * u / np.maximum(np.hypot(*u.T), 1e-12)[:, None]
        for k in np.flatnonzero(moving):
            lines[k].append(here[k].copy())
        moving &= np.hypot(*(here - world.goal).T) > AT_GOAL_M
    return [np.array(line) for line in lines]


@dataclass(frozen=True)
class StreamlineStatistics:
    """Share of streamlines that arrive, mean and largest heading error, and least distance divided by S_oe."""

    arrived: float
    error_deg: float
    worst_deg: float
    nearest: float


def statistics(world: FieldWorld, lines: list[np.ndarray]) -> StreamlineStatistics:
    """Statistics of the streamlines of one seed."""
    arrived, errors, nearest = [], [], math.inf
    for line in lines:
        arrived.append(np.hypot(*(line[-1] - world.goal)) <= AT_GOAL_M)
        if arrived[-1]:
            step = line[-1] - line[-2]
            off = math.atan2(step[1], step[0]) - world.heading
            errors.append(abs(math.degrees((off + math.pi) % (2 * math.pi) - math.pi)))
        away = np.hypot(*(line[:, None] - world.centres).transpose(2, 0, 1))
        nearest = min(nearest, float((away / world.extended_m).min()))
    return StreamlineStatistics(
        float(np.mean(arrived)),
        mean(errors),
        max(errors, default=math.nan),
        nearest,
    )


def plot(
    world: FieldWorld, lines: dict[str, list[np.ndarray]], configs: dict[str, FieldConfig]
) -> Figure:
    """Plot of the field and its streamlines, one panel for each pair of weights."""
    from matplotlib.patches import Circle

    axis = np.linspace(-SIDE_M / 2, SIDE_M / 2, ARROWS)
    places = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    figure, axes = sheet(1, len(configs), height_in=4.4, sharey=True)
    for panel, (name, config) in zip(axes, configs.items(), strict=True):
        u = fields.total(places, world.goal, world.heading, world.centres, world.extended_m, config)
        u = u / np.maximum(np.hypot(*u.T), 1e-12)[:, None]
        panel.quiver(*places.T, *u.T, color="#9AA3AC", scale=38, width=0.0028, pivot="mid")
        for centre, radius in zip(world.centres, world.extended_m, strict=True):
            panel.add_patch(Circle(tuple(centre), radius, color=FAINT, zorder=2))
            panel.add_patch(Circle(tuple(centre), 0.10, color=WRONG, zorder=3))
        for line in lines[name]:
            panel.plot(*line.T, color=ESTIMATE, linewidth=1.0, zorder=4)
        tip = 0.35 * np.array([math.cos(world.heading), math.sin(world.heading)])
        panel.annotate(
            "",
            xy=tuple(world.goal + tip),
            xytext=tuple(world.goal),
            arrowprops={"arrowstyle": "-|>", "color": TARGET, "linewidth": 2.0},
            zorder=6,
        )
        panel.plot(*world.goal, "o", color=TARGET, markersize=5, zorder=6)
        panel.set(
            title=name, aspect="equal", xlabel="x, m",
            xlim=(-SIDE_M / 2, SIDE_M / 2), ylim=(-SIDE_M / 2, SIDE_M / 2),
        )  # fmt: skip
    axes[0].set_ylabel("y, m")
    return figure


def run(seeds: int, say: Say) -> Outcome:
    """A few seconds per seed."""
    configs = {
        "ours: w_muf 0.25, w_auf 0.75": FieldConfig(),
        "as printed: w_muf 0.75, w_auf 0.25": PUBLISHED,
    }
    ours, printed, alone, literal = [], [], [], []
    table = ["seed  arrived %  error deg (worst)  nearest/S_oe   printed: arrived %  nearest/S_oe"]
    for seed in range(seeds):
        world = draw(seed)
        lines = {name: streamlines(world, config, True) for name, config in configs.items()}
        a, b = (statistics(world, found) for found in lines.values())
        ours.append(a)
        printed.append(b)
        alone.append(statistics(world, streamlines(world, FieldConfig(), False)))
        literal.append(statistics(world, streamlines(world, PUBLISHED, True, literal=True)))
        if seed == 0:
            portrait = Drawing("portrait", PORTRAIT_SAID, partial(plot, world, lines, configs))
        table.append(
            f"{seed:4d}  {100 * a.arrived:9.0f}  {a.error_deg:9.2f} ({a.worst_deg:.2f})"
            f"  {a.nearest:12.2f}  {100 * b.arrived:18.0f}  {b.nearest:12.2f}"
        )
        say(table[-1])
    figures = {
        "arrived_share": float(np.mean([one.arrived for one in ours])),
        "arrival_error_deg": max(one.worst_deg for one in ours),
        "arrival_error_mean_deg": float(np.mean([one.error_deg for one in ours])),
        "nearest_share_of_s_oe": min(one.nearest for one in ours),
        "arrived_share_muf": float(np.mean([one.arrived for one in alone])),
        "arrival_error_deg_muf": max(one.worst_deg for one in alone),
        "arrived_share_printed": float(np.mean([one.arrived for one in printed])),
        "nearest_share_of_s_oe_printed": min(one.nearest for one in printed),
        "arrived_share_literal": float(np.mean([one.arrived for one in literal])),
    }
    return Outcome(figures, table, ROWS, [portrait])


EXPERIMENT = Experiment(
    id="001-E1",
    title="Streamlines of the univector field with arrival angle, ours and as printed (Yoo and Kim 2010)",
    run=run,
    targets={
        "arrived_share": Target("==", 1.0),
        "arrival_error_deg": Target("<=", 5.0),
        "nearest_share_of_s_oe": Target(">=", 1.0),
    },
    seeds=10,
)
