"""The whole decision: from what stands around to a side, a motion and a pivot, with the reasons in words.

Source: seed 004, sections 2.3 and 2.4; the second try on the other side is the specification's option.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from perception.primitives.errors import ConfigError
from perception.primitives.robot_model import DARWIN_OP, RobotModel

from .complexity import FORMS, complexity
from .direction import TIE, blocking, direction
from .fams import MOTIONS, FamsConfig, select, strengths
from .pivot import Pivot, PivotConfig, pivot


@dataclass(frozen=True)
class AvoidanceConfig:
    """Of the decision."""

    complexity: str = (
        "frontal"  # specification; "integrated" does not jump where a thing is dead ahead
    )
    tie: float = TIE
    other_side: bool = True  # specification's option: try it before stopping; the paper keeps D
    abreast: float = (
        0.5  # ours: nearer than this share of the group's distance is beside, not ahead
    )
    alongside_m: float = 0.3  # specification: neighbours this much farther still bound the gap
    touch_m: float = 0.03  # ours: who overlaps another by less across the way stands beside it
    fams: FamsConfig = field(default_factory=FamsConfig)
    pivot: PivotConfig = field(default_factory=PivotConfig)

    def __post_init__(self) -> None:
        if self.complexity not in FORMS:
            raise ConfigError(
                f"avoidance: complexity={self.complexity!r} is unknown; use one of {', '.join(FORMS)}"
            )


@dataclass(frozen=True, eq=False)
class ObstacleTable:
    """What stands around, as plain arrays, base frame.

    Args:
        edges_rad: (n, 2) azimuths of left and right edges, left positive.
        edges_m: (n, 2) y of left and right edges, left positive, m.
        distance_m, width_m, height_m: (n,) forward distance, width across the way, height.
        sigma_m: (n,) deviation of an edge's place across the way.
        open_m: Where the known ground ends on the left and on the right, y.
    """

    edges_rad: Float[np.ndarray, "n 2"]
    edges_m: Float[np.ndarray, "n 2"]
    distance_m: Float[np.ndarray, "n"]
    width_m: Float[np.ndarray, "n"]
    height_m: Float[np.ndarray, "n"]
    sigma_m: Float[np.ndarray, "n"]
    open_m: tuple[float, float] = (2.0, -2.0)


@dataclass(frozen=True)
class Choice:
    """What was decided, and why.

    Args:
        motion: One of `fams.MOTIONS`.
        side: D, +1 left, -1 right.
        pivot: Where to go first.
        total: Sum of the complexity measures, right positive.
        width_m, gap_m, distance_m: w_l, s_l and d_l that the selection saw.
        fits: How well each motion fits, in the order of `MOTIONS`.
        why: The same in words.
    """

    motion: str
    side: int
    pivot: Pivot
    total: float
    width_m: float
    gap_m: float
    distance_m: float
    fits: tuple[float, ...]
    why: str


def choose(
    things: ObstacleTable, config: AvoidanceConfig | None = None, robot: RobotModel = DARWIN_OP
) -> Choice | None:
    """Decide; None if nothing blocks the way."""
    config = AvoidanceConfig() if config is None else config
    left, right = things.edges_m[:, 0], things.edges_m[:, 1]
    body_m = robot.passage_width_m
    corridor = body_m + 2 * config.pivot.clearance_m
    blocked = blocking(left, right, things.distance_m, corridor)
    group = _joined(things, _parted(things, blocked, config.fams.narrowest_m(body_m)), config)
    if not group.any():
        return None
    ahead = things.distance_m >= config.abreast * things.distance_m[group].min()
    total = float(
        complexity(
            things.edges_rad[ahead],
            things.distance_m[ahead],
            things.width_m[ahead],
            things.height_m[ahead],
            config.complexity,
        ).sum()
    )
    gaps = {side: _gap(things, group, side, config.alongside_m) for side in (1, -1)}
    side = direction(total, gaps[1][0], gaps[-1][0], config.tie)
    found = _on_side(things, group, side, gaps[side], total, config, body_m)
    if found.motion == "ST" and config.other_side:
        other = _on_side(things, group, -side, gaps[-side], total, config, body_m)
        return found if other.motion == "ST" else other
    return found


def _parted(things: ObstacleTable, group: np.ndarray, narrowest_m: float) -> np.ndarray:
    """Of a group with a way through it the part that is nearest to straight ahead."""
    index = np.flatnonzero(group)
    index = index[np.argsort(-things.edges_m[index, 0])]
    if not len(index):
        return group
    left, right = things.edges_m[index].T
    ends = np.minimum.accumulate(right)
    parts = np.split(index, np.flatnonzero(ends[:-1] - left[1:] >= narrowest_m) + 1)

    def aside(part: np.ndarray) -> float:
        return max(0.0, -things.edges_m[part, 0].max(), things.edges_m[part, 1].min())

    chosen = np.zeros(len(group), np.bool_)
    chosen[min(parts, key=aside)] = True
    return chosen


def _joined(things: ObstacleTable, group: np.ndarray, config: AvoidanceConfig) -> np.ndarray:
    """The group with every neighbour that overlaps it across the way at about its distance."""
    group = group.copy()
    while group.any():
        left, right = things.edges_m[group, 0].max(), things.edges_m[group, 1].min()
        nearest = things.distance_m[group].min()
        near = np.abs(things.distance_m - nearest) <= config.alongside_m
        more = near & (things.edges_m[:, 1] < left - config.touch_m) & ~group
        more &= things.edges_m[:, 0] > right + config.touch_m
        if not more.any():
            break
        group |= more
    return group


def _gap(
    things: ObstacleTable, group: np.ndarray, side: int, alongside_m: float
) -> tuple[float, float, float]:
    """Free way beside the group: width, its deviation, and the group's edge there."""
    own, facing = (0, 1) if side > 0 else (1, 0)
    index = np.flatnonzero(group)
    at = index[np.argmax(side * things.edges_m[index, own])]
    edge = float(things.edges_m[at, own])
    distance = float(things.distance_m[group].min())
    beside = ~group & (side * things.edges_m[:, own] > side * edge)
    beside &= things.distance_m <= distance + alongside_m
    gaps = side * (things.edges_m[beside, facing] - edge)
    sigma = float(things.sigma_m[at])
    known = max(side * (things.open_m[own] - edge), 0.0)
    if not beside.any() or known < float(gaps.min()):
        return known, sigma, edge
    nearest = int(np.argmin(gaps))
    return (
        float(gaps[nearest]),
        math.hypot(sigma, float(things.sigma_m[beside][nearest])),
        edge,
    )


def _on_side(
    things: ObstacleTable,
    group: np.ndarray,
    side: int,
    gap: tuple[float, float, float],
    total: float,
    config: AvoidanceConfig,
    body_m: float,
) -> Choice:
    """Motion and pivot on one side."""
    free, sigma, edge = gap
    width = float(things.edges_m[group, 0].max() - things.edges_m[group, 1].min())
    distance = float(things.distance_m[group].min())
    seen = np.array([width]), np.array([free]), config.fams, np.array([sigma]), body_m
    fits, chosen = strengths(*seen)[:, 0], int(select(*seen)[0])
    motion = MOTIONS[chosen]
    at = pivot(motion, side, edge, free, width, distance, config.pivot, body_m)
    word = "left" if side > 0 else "right"
    why = (
        f"blocked at {distance:.2f} m by {width:.2f} m; complexity {total:+.2f}, so {word}; "
        f"gap there {free:.2f} m (+-{1e3 * sigma:.0f} mm), body {body_m:.2f} m: "
        f"{motion} ({float(fits[chosen]):.2f})"
    )
    if motion != "ST":
        why += f", pivot {at.distance_m:.2f} m at {math.degrees(at.turn_rad):+.0f} deg"
    return Choice(
        motion, side, at, total, width, free, distance, tuple(float(f) for f in fits), why
    )
