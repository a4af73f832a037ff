"""The decision: side, motion and pivot for the obstacles ahead, with the reasons in words.

Source: Kang 2013 (seed 004), sections 2.3 and 2.4; the second try on the other side is ours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from perception.primitives.errors import ConfigError
from perception.primitives.robot_model import RobotModel
from perception.primitives.settings import setting

from .complexity import FORMS, complexity
from .direction import blocking, direction
from .fams import MOTIONS, FamsConfig, select, strengths
from .pivot import Pivot, PivotConfig, pivot

ABREAST = 0.5  # ours: an obstacle nearer than this share of the distance of the group is beside, not ahead
ALONGSIDE_M = 0.3  # ours: neighbours farther than the group by up to this bound the gap
TOUCH_M = 0.03  # ours: obstacles that overlap by less are side by side


@dataclass(frozen=True)
class AvoidanceConfig:
    """Settings of the decision."""

    complexity: str = setting(
        "frontal",
        "",
        "form of the complexity measure: frontal, ratio or integrated (continuous straight ahead)",
        "ours; lost in seed 004",
    )
    other_side: bool = setting(
        True, "", "try the other side before stopping", "ours; seed 004 keeps the side"
    )
    least_fit: float = setting(
        0.8,
        "",
        "least probability that the body fits through the gap; below it side steps replace walking, and a stop side steps",
        "ours",
    )
    fams: FamsConfig = field(default_factory=FamsConfig)
    pivot: PivotConfig = field(default_factory=PivotConfig)

    def __post_init__(self) -> None:
        if self.complexity not in FORMS:
            raise ConfigError(
                f"avoidance: complexity={self.complexity!r} is unknown; use one of {', '.join(FORMS)}"
            )
        if not 0.0 <= self.least_fit < 1.0:
            raise ConfigError(f"avoidance: least_fit={self.least_fit} must lie in [0, 1)")


@dataclass(frozen=True, eq=False)
class ObstacleTable:
    """Obstacles as arrays, base frame.

    Args:
        edges_rad: (n, 2) azimuths of left and right edges, left positive.
        edges_m: (n, 2) lateral positions of the seen left and right edges, left positive, m.
        ends_m: (n, 2) expected lateral positions of the ends, with what may be hidden beyond the edges, m.
        distance_m, width_m, height_m: (n,) forward distance, lateral width, height, m.
        sigma_m: (n, 2) standard deviations of the ends, m.
        open_m: Lateral positions where the known ground ends on the left and on the right.
    """

    edges_rad: Float[np.ndarray, "n 2"]
    edges_m: Float[np.ndarray, "n 2"]
    ends_m: Float[np.ndarray, "n 2"]
    distance_m: Float[np.ndarray, "n"]
    width_m: Float[np.ndarray, "n"]
    height_m: Float[np.ndarray, "n"]
    sigma_m: Float[np.ndarray, "n 2"]
    open_m: tuple[float, float] = (2.0, -2.0)


@dataclass(frozen=True)
class Choice:
    """The decision and its reasons.

    Args:
        motion: One of `fams.MOTIONS`.
        side: D, +1 left, -1 right.
        pivot: The first target.
        total: Sum of the complexity measures, right positive.
        width_m, gap_m, distance_m: w_l, s_l and d_l of the selection.
        fits: Strength of each motion, in the order of `MOTIONS`.
        passes: Probability that the body fits through the gap with this motion; for a stop, with side steps.
        why: The decision in words.
    """

    motion: str
    side: int
    pivot: Pivot
    total: float
    width_m: float
    gap_m: float
    distance_m: float
    fits: tuple[float, ...]
    passes: float
    why: str


def choose(obstacles: ObstacleTable, config: AvoidanceConfig, robot: RobotModel) -> Choice | None:
    """The decision; None if no obstacle is in the corridor."""
    left, right = obstacles.edges_m[:, 0], obstacles.edges_m[:, 1]
    body_m = robot.passage_width_m
    corridor = body_m + 2 * config.pivot.clearance_m
    blocked = blocking(left, right, obstacles.distance_m, corridor)
    group = _joined(obstacles, _parted(obstacles, blocked, config.fams.narrowest_m(body_m)))
    if not group.any():
        return None
    ahead = obstacles.distance_m >= ABREAST * obstacles.distance_m[group].min()
    total = float(
        complexity(
            obstacles.edges_rad[ahead],
            obstacles.distance_m[ahead],
            obstacles.width_m[ahead],
            obstacles.height_m[ahead],
            config.complexity,
        ).sum()
    )
    gaps = {side: _gap(obstacles, group, side) for side in (1, -1)}
    side = direction(total, gaps[1][0], gaps[-1][0])
    found = _on_side(obstacles, group, side, gaps[side], total, config, body_m)
    if found.motion == "ST" and config.other_side:
        other = _on_side(obstacles, group, -side, gaps[-side], total, config, body_m)
        return found if other.motion == "ST" else other
    return found


def _parted(obstacles: ObstacleTable, group: np.ndarray, narrowest_m: float) -> np.ndarray:
    """The part of a group nearest to straight ahead, if there is a passage through the group."""
    index = np.flatnonzero(group)
    index = index[np.argsort(-obstacles.edges_m[index, 0])]
    if not len(index):
        return group
    left, right = obstacles.edges_m[index].T
    ends = np.minimum.accumulate(right)
    parts = np.split(index, np.flatnonzero(ends[:-1] - left[1:] >= narrowest_m) + 1)

    def lateral(part: np.ndarray) -> float:
        return max(0.0, -obstacles.edges_m[part, 0].max(), obstacles.edges_m[part, 1].min())

    chosen = np.zeros(len(group), np.bool_)
    chosen[min(parts, key=lateral)] = True
    return chosen


def _joined(obstacles: ObstacleTable, group: np.ndarray) -> np.ndarray:
    """The group with all neighbours at about its distance that overlap it laterally."""
    group = group.copy()
    while group.any():
        left, right = obstacles.edges_m[group, 0].max(), obstacles.edges_m[group, 1].min()
        nearest = obstacles.distance_m[group].min()
        near = np.abs(obstacles.distance_m - nearest) <= ALONGSIDE_M
        more = near & (obstacles.edges_m[:, 1] < left - TOUCH_M) & ~group
        more &= obstacles.edges_m[:, 0] > right + TOUCH_M
        if not more.any():
            break
        group |= more
    return group


def _gap(obstacles: ObstacleTable, group: np.ndarray, side: int) -> tuple[float, float, float]:
    """Gap beside the group: expected width, its standard deviation, and lateral position of the end of the group, m."""
    own, facing = (0, 1) if side > 0 else (1, 0)
    index = np.flatnonzero(group)
    at = index[np.argmax(side * obstacles.ends_m[index, own])]
    edge, seen = float(obstacles.ends_m[at, own]), float(obstacles.edges_m[at, own])
    distance = float(obstacles.distance_m[group].min())
    beside = ~group & (side * obstacles.edges_m[:, own] > side * seen)
    beside &= obstacles.distance_m <= distance + ALONGSIDE_M
    gaps = side * (obstacles.ends_m[beside, facing] - edge)
    sigma = float(obstacles.sigma_m[at, own])
    known = max(side * (obstacles.open_m[own] - edge), 0.0)
    if not beside.any() or known < float(gaps.min()):
        return known, sigma, edge
    nearest = int(np.argmin(gaps))
    return (
        float(gaps[nearest]),
        math.hypot(sigma, float(obstacles.sigma_m[beside, facing][nearest])),
        edge,
    )


def _on_side(
    obstacles: ObstacleTable,
    group: np.ndarray,
    side: int,
    gap: tuple[float, float, float],
    total: float,
    config: AvoidanceConfig,
    body_m: float,
) -> Choice:
    """Motion and pivot on one side."""
    free, sigma, edge = gap
    width = float(obstacles.edges_m[group, 0].max() - obstacles.edges_m[group, 1].min())
    distance = float(obstacles.distance_m[group].min())
    seen = np.array([width]), np.array([free]), config.fams, np.array([sigma]), body_m
    fits, chosen = strengths(*seen)[:, 0], int(select(*seen)[0])
    motion, passes = _that_fits(MOTIONS[chosen], free, sigma, config, body_m)
    at = pivot(motion, side, edge, free, width, distance, config.pivot, body_m)
    word = "left" if side > 0 else "right"
    gap_text = f"gap there {free:.2f} m (+-{1e3 * sigma:.0f} mm)" if free > 0.0 else "no gap there"
    why = (
        f"blocked at {distance:.2f} m by {width:.2f} m; complexity {total:+.2f}, so {word}; "
        f"{gap_text}, body {body_m:.2f} m, fits with {passes:.2f}: "
        f"{motion} ({float(fits[MOTIONS.index(motion)]):.2f})"
    )
    if motion != "ST":
        why += f", pivot {at.distance_m:.2f} m at {math.degrees(at.turn_rad):+.0f} deg"
    return Choice(
        motion, side, at, total, width, free, distance, tuple(float(f) for f in fits), passes, why
    )


def _that_fits(
    motion: str, free_m: float, sigma_m: float, config: AvoidanceConfig, body_m: float
) -> tuple[str, float]:
    """The motion, replaced by side steps or a stop if it surely enough does not fit, and the probability that it fits."""

    def fit(needed_m: float) -> float:
        if sigma_m == 0.0:
            return float(free_m >= needed_m)
        return 0.5 * math.erfc((needed_m - free_m) / (sigma_m * math.sqrt(2.0)))

    if motion.endswith("F"):
        forward = fit(body_m)
        if forward >= config.least_fit:
            return motion, forward
        motion = motion[0] + "S"
    sideways = fit(config.fams.narrowest_m(body_m))
    return (motion if sideways >= config.least_fit else "ST"), sideways
