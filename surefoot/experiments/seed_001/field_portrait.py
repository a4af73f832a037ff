"""The portrait of the field: to a goal with an arrival angle, among obstacles, with both pairs of weights.

A point that follows the field from evenly spaced starts all round arrives with the wanted heading. Beside the
published weights, which let it run deep into the obstacles, stand ours. Every seed moves goal and obstacles; the
first is the paper's picture, th_tg = pi/6. The portraits go to runs/001-E1/.

Source: seed 001, Fig. 3; specification, section 4 (weights).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from planning.univector import fields
from planning.univector.fields import PUBLISHED, FieldConfig

from ...report.plots.style import ESTIMATE, FAINT, TARGET, WRONG, png, sheet, styled
from ..support.experiment import Experiment, Outcome, Say, Target

FOLDER = Path("runs") / "001-E1"
SIDE_M = 4.0  # of the picture
STARTS = 24  # evenly spaced along its edge
STEP_M = 0.005
AT_GOAL_M = 0.03
LONGEST_M = 60.0  # then it is lost; on the axis ahead of the goal the field turns aside only slowly
OBSTACLES = 4
CLEAR_M = 1.3  # middle of an obstacle to the goal: the last metre belongs to the arrival angle
ARROWS = 33


@dataclass(frozen=True)
class Portrait:
    """One world.

    Args:
        goal, heading: p_d, m, and th_tg, rad.
        centres, extended_m: Of the obstacles, m.
    """

    goal: Float[np.ndarray, "2"]
    heading: float
    centres: Float[np.ndarray, "n 2"]
    extended_m: Float[np.ndarray, "n"]


def draw(seed: int) -> Portrait:
    """Goal near the middle, obstacles round it; seed 0 has the paper's arrival angle."""
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
    return Portrait(goal, heading, np.array(centres), extended)


def starts(world: Portrait) -> Float[np.ndarray, "n 2"]:
    """Evenly spaced along the edge of the picture, outside every obstacle."""
    along = (np.arange(STARTS) + 0.5) / STARTS * 4.0
    half, side = SIDE_M / 2, along.astype(int) % 4
    t = (along % 1.0 - 0.5) * SIDE_M
    edge = np.full(STARTS, half)
    x = np.choose(side, [t, edge, -t, -edge])
    y = np.choose(side, [-edge, t, edge, -t])
    return np.column_stack([x, y])


def follow(
    world: Portrait, config: FieldConfig, among: bool, literal: bool = False
) -> list[Float[np.ndarray, "n 2"]]:
    """The tracks of points that follow the field, all at once, each until the goal.

    Args:
        world: Goal and obstacles.
        config: Weights.
        among: With the obstacles; else the move-to-goal field alone.
        literal: Nothing inside S_oe, as printed.
    """
    here = starts(world)
    tracks = [[place.copy()] for place in here]
    under_way = np.ones(len(here), dtype=bool)
    for _ in range(round(LONGEST_M / STEP_M)):
        if not under_way.any():
            break
        if among:
            u = fields.total(
                *(here[under_way], world.goal, world.heading),
                *(world.centres, world.extended_m, config),
            )
            if literal:
                u = fields.move_to_goal(here[under_way], world.goal, world.heading, config)
                aside = fields.avoid(
                    *(here[under_way], world.goal, world.centres, world.extended_m, config),
                    literal=True,
                )
                u = config.w_goal * u + config.w_avoid * aside
        else:
            u = fields.move_to_goal(here[under_way], world.goal, world.heading, config)
        here[under_way] += STEP_M * u / np.maximum(np.hypot(*u.T), 1e-12)[:, None]
        for k in np.flatnonzero(under_way):
            tracks[k].append(here[k].copy())
        under_way &= np.hypot(*(here - world.goal).T) > AT_GOAL_M
    return [np.array(track) for track in tracks]


@dataclass(frozen=True)
class Fate:
    """How the tracks of one portrait ended: arrived share, errors of heading, least gap over S_oe."""

    arrived: float
    error_deg: float
    worst_deg: float
    nearest: float


def fate(world: Portrait, tracks: list[np.ndarray]) -> Fate:
    """Judge the tracks; the nearest distance as a share of S_oe."""
    arrived, errors, nearest = [], [], math.inf
    for track in tracks:
        arrived.append(np.hypot(*(track[-1] - world.goal)) <= AT_GOAL_M)
        if arrived[-1]:
            step = track[-1] - track[-2]
            off = math.atan2(step[1], step[0]) - world.heading
            errors.append(abs(math.degrees((off + math.pi) % (2 * math.pi) - math.pi)))
        away = np.hypot(*(track[:, None] - world.centres).transpose(2, 0, 1))
        nearest = min(nearest, float((away / world.extended_m).min()))
    return Fate(
        float(np.mean(arrived)),
        float(np.mean(errors)) if errors else math.nan,
        max(errors, default=math.nan),
        nearest,
    )


def picture(
    world: Portrait, tracks: dict[str, list[np.ndarray]], configs: dict[str, FieldConfig]
) -> bytes:
    """Arrows of the field and the tracks, one panel for each pair of weights."""
    from matplotlib.patches import Circle

    axis = np.linspace(-SIDE_M / 2, SIDE_M / 2, ARROWS)
    places = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    with styled():
        figure, axes = sheet(1, len(configs), height_in=4.4, sharey=True)
        for panel, (name, config) in zip(axes, configs.items(), strict=True):
            u = fields.total(
                places, world.goal, world.heading, world.centres, world.extended_m, config
            )
            u = u / np.maximum(np.hypot(*u.T), 1e-12)[:, None]
            panel.quiver(*places.T, *u.T, color="#9AA3AC", scale=38, width=0.0028, pivot="mid")
            for centre, radius in zip(world.centres, world.extended_m, strict=True):
                panel.add_patch(Circle(tuple(centre), radius, color=FAINT, zorder=2))
                panel.add_patch(Circle(tuple(centre), 0.10, color=WRONG, zorder=3))
            for track in tracks[name]:
                panel.plot(*track.T, color=ESTIMATE, linewidth=1.0, zorder=4)
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
        return png(figure)


def run(seeds: int, say: Say) -> Outcome:
    """A few seconds a seed."""
    configs = {
        "ours: w_muf 0.25, w_auf 0.75": FieldConfig(),
        "as printed: w_muf 0.75, w_auf 0.25": PUBLISHED,
    }
    ours, printed, alone = [], [], []
    table = ["seed  arrived %  error deg (worst)  nearest/S_oe   printed: arrived %  nearest/S_oe"]
    for seed in range(seeds):
        world = draw(seed)
        tracks = {name: follow(world, config, True) for name, config in configs.items()}
        a, b = (fate(world, found) for found in tracks.values())
        ours.append(a)
        printed.append(b)
        alone.append(fate(world, follow(world, FieldConfig(), False)))
        if seed == 0:
            FOLDER.mkdir(parents=True, exist_ok=True)
            (FOLDER / "portrait.png").write_bytes(picture(world, tracks, configs))
            table.insert(0, f"picture: {FOLDER / 'portrait.png'}")
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
    }
    return Outcome(figures, table)


EXPERIMENT = Experiment(
    id="001-E1",
    title="Portrait of the univector field with arrival angle, ours and as printed",
    run=run,
    targets={
        "arrived_share": Target("==", 1.0),
        "arrival_error_deg": Target("<=", 5.0),
        "nearest_share_of_s_oe": Target(">=", 1.0),
    },
    seeds=10,
)
