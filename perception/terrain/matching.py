"""Which regions may be the treads and risers of one staircase, and the number of each.

A direction is proposed by every upright region that faces the camera and every edge at which a level region ends. Levels that
are evenly spaced in height get their numbers by it; nosings and risers have the number of their tread, and must be evenly
spaced along the direction.

Source: ours.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from ..primitives.plane import Plane
from .region import EdgeKind, Region

RISER_M = (0.08, 0.25)  # ours: building codes have .10 to .22; a higher step is climbed, not walked
TREAD_M = (0.18, 0.45)  # ours: building codes have .21 to .36
LEVEL_RAD = math.radians(6.0)  # ours: of a tread beside the uncertainty of up; ramps begin at 4 deg
UPRIGHT_RAD = math.radians(15.0)  # ours: risers may lean
PARALLEL_RAD, SAME_RAD = math.radians(8.0), math.radians(1.5)  # ours
HEIGHT_M, PLACE_M = 0.03, 0.06  # ours: how far from even spacing a candidate may be, before the fit
LEAST_WIDE_M = 0.30  # ours: of a tread or riser, as far as it is seen; boxes are narrower
LEAST_COMMON = 0.5  # ours: share of the narrowest that all have in common
MOST_MISSING = 1  # ours: steps between others that are not seen
UP_SIGMAS = 3.0  # ours
RISER_TOP = 0.8  # ours: the middle of a riser is half a riser below its tread, that of a board 0.1
MOST_MATCHES = 6  # ours


@dataclass(frozen=True)
class Nosing:
    """A line across the staircase: the plane of a riser, or an edge of a tread.

    Args:
        region: The riser, or the tread.
        number: Of the step.
        ends: (2, 3), camera frame, m.
        middle: Where its place is measured, camera frame, m.
        covariance: (2, 2) of (yaw, place along the direction), given the plane of the region.
        shared_m: Standard deviation of a shift that all edges of a view share, m; 0 for a riser.
        is_riser: Whether it is a riser.
    """

    region: int
    number: int
    ends: Float[np.ndarray, "2 3"]
    middle: Float[np.ndarray, "3"]
    covariance: Float[np.ndarray, "2 2"]
    shared_m: float
    is_riser: bool


@dataclass(frozen=True)
class Match:
    """Regions with their numbers, and approximate parameters.

    Args:
        levels: Index and number of every level region.
        nosings: Risers, or edges of treads.
        yaw: Of the direction of rise, about the tangents of the prior, rad.
        s0, tread_m, h0, riser_m: Nosings lie at s0 + k tread, levels at h0 + k riser, from the camera, m.
    """

    levels: tuple[tuple[int, int], ...]
    nosings: tuple[Nosing, ...]
    yaw: float
    s0: float
    tread_m: float
    h0: float
    riser_m: float

    @staticmethod
    def axes(
        prior: Plane, angles: Float[np.ndarray, "3"]
    ) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
        """Up, direction of rise, and left of it, for two tilts of the prior and a yaw, camera frame."""
        up = prior.normal + angles[:2] @ prior.tangents
        up = up / np.linalg.norm(up)
        ahead = prior.tangents[0] - (prior.tangents[0] @ up) * up
        ahead = ahead / np.linalg.norm(ahead)
        direction = math.cos(angles[2]) * ahead + math.sin(angles[2]) * np.cross(up, ahead)
        return up, direction, np.cross(up, direction)

    def without(self, measurement: int) -> Match:
        """The match without one of its levels, or one of its nosings, counted after the levels."""
        if measurement < len(self.levels):
            levels = self.levels[:measurement] + self.levels[measurement + 1 :]
            return replace(self, levels=levels)
        k = measurement - len(self.levels)
        return replace(self, nosings=self.nosings[:k] + self.nosings[k + 1 :])


@dataclass(frozen=True)
class _Line:
    """A possible nosing: its region, where it is, and the direction in which its staircase rises."""

    region: int
    ends: Float[np.ndarray, "2 3"]
    middle: Float[np.ndarray, "3"]
    covariance: Float[np.ndarray, "2 2"]
    shared_m: float
    is_riser: bool
    yaw: float


def matches(regions: list[Region], prior: Plane) -> Iterator[Match]:
    """Possible staircases, the one that explains most first."""
    doubt = UP_SIGMAS * math.sqrt(float(np.linalg.eigvalsh(prior.covariance[:2, :2])[-1]))
    level = [k for k, one in enumerate(regions) if one.slope_rad(prior.normal) < LEVEL_RAD + doubt]
    if len(level) < 2:
        return
    normals = sum(regions[k].area_m2 * regions[k].plane.normal for k in level)
    tilt = np.append(prior.tangents @ normals / float(prior.normal @ normals), 0.0)
    up, ahead, left = Match.axes(prior, tilt)
    upright = [
        k for k, one in enumerate(regions) if one.slope_rad(up) > math.pi / 2 - UPRIGHT_RAD - doubt
    ]
    lines = list(_lines(regions, level, upright, up, ahead, left))
    found: list[tuple[Match, int, float]] = []
    heights = {k: float(up @ regions[k].middle) for k in level}
    spacings = list(_spacings(heights))
    for yaw in _directions(lines):
        direction = math.cos(yaw) * ahead + math.sin(yaw) * left
        parallel = [line for line in lines if abs(_turn(line.yaw - yaw)) < PARALLEL_RAD]
        for riser, first, numbers in spacings:
            for risers in (True, False):
                kept = [line for line in parallel if line.is_riser == risers]
                match = _matched(regions, numbers, kept, first, riser, direction, up, yaw)
                if match is not None:
                    found.append((match, *_worth(match, regions)))
    found.sort(key=lambda rated: rated[1:], reverse=True)
    for match, _, _ in found[:MOST_MATCHES]:
        yield match


def _worth(match: Match, regions: list[Region]) -> tuple[int, float]:
    """Levels and nosings seen less steps missing, as half the riser and half the tread explain all too; area."""
    levels = {number for _, number in match.levels}
    nosings = {one.number for one in match.nosings}
    numbers = levels | nosings
    area = sum(regions[k].area_m2 for k, _ in match.levels)
    missing = max(numbers) - min(numbers) + 1 - len(numbers)
    return len(levels) + len(nosings) - 2 * missing, area


def _directions(lines: list[_Line]) -> list[float]:
    """Yaws of the lines, of those that are nearly the same only the first."""
    found: list[float] = []
    for one in lines:
        if all(abs(_turn(one.yaw - yaw)) > SAME_RAD for yaw in found):
            found.append(one.yaw)
    return found


def _turn(angle: float) -> float:
    """An angle in (-pi, pi]."""
    return math.remainder(angle, 2.0 * math.pi)


def _lines(
    regions: list[Region],
    level: list[int],
    upright: list[int],
    up: Float[np.ndarray, "3"],
    ahead: Float[np.ndarray, "3"],
    left: Float[np.ndarray, "3"],
) -> Iterator[_Line]:
    """Risers that face the camera, and edges at which level regions end."""
    for k in upright:
        one = regions[k]
        facing = -one.plane.normal
        yaw = math.atan2(float(facing @ left), float(facing @ ahead))
        across = np.cross(up, facing)
        across /= np.linalg.norm(across)
        low, high = np.sort((one.outline - one.middle) @ across)[[0, -1]]
        if high - low < LEAST_WIDE_M:
            continue
        ends = one.middle + np.outer([low, high], across)
        yield _Line(k, ends, one.middle, np.zeros((2, 2)), 0.0, True, yaw)
    for k in level:
        for edge in regions[k].edges:
            if edge.kind == EdgeKind.CONCAVE or edge.length_m < LEAST_WIDE_M:
                continue
            across = np.cross(up, edge.along)
            inward = float(across @ (regions[k].middle - edge.middle))
            rise = math.copysign(1.0, inward) * across
            yaw = math.atan2(float(rise @ left), float(rise @ ahead))
            sign = np.diag([1.0, math.copysign(1.0, inward)])
            P = sign @ edge.covariance @ sign
            yield _Line(k, edge.ends, edge.middle, P, edge.shared_m, False, yaw)


def _spacings(heights: dict[int, float]) -> Iterator[tuple[float, float, dict[int, int]]]:
    """Rises of a step, the height of level 0, and the number of every level that fits; each set of numbers once."""
    tried: set[tuple[tuple[int, int], ...]] = set()
    for one, two in itertools.combinations(heights.values(), 2):
        for steps in range(1, MOST_MISSING + 2):
            riser = abs(two - one) / steps
            if not RISER_M[0] <= riser <= RISER_M[1]:
                continue
            base = min(one, two)
            numbers = {k: round((h - base) / riser) for k, h in heights.items()}
            numbers = {
                k: number
                for k, number in numbers.items()
                if abs(heights[k] - base - number * riser) < HEIGHT_M
            }
            lowest = min(numbers.values())
            key = tuple((k, number - lowest) for k, number in numbers.items())
            if key not in tried:
                tried.add(key)
                yield riser, base, numbers


def _longest(placed: list[tuple[int, float, _Line]]) -> list[tuple[int, float, _Line]]:
    """One line of every region: a ragged border gives several, and their errors are the same."""
    found: dict[int, tuple[int, float, _Line]] = {}
    for one in placed:
        kept = found.get(one[2].region)
        if kept is None or np.ptp(one[2].ends, axis=0).max() > np.ptp(kept[2].ends, axis=0).max():
            found[one[2].region] = one
    return list(found.values())


def _matched(
    regions: list[Region],
    numbers: dict[int, int],
    lines: list[_Line],
    base: float,
    riser: float,
    direction: Float[np.ndarray, "3"],
    up: Float[np.ndarray, "3"],
    yaw: float,
) -> Match | None:
    """The largest set of evenly spaced lines with the levels between them; None if there are no two."""
    placed = []
    for line in lines:
        s = float(direction @ line.middle)
        if line.is_riser:
            number = math.floor((float(up @ line.middle) - base) / riser + RISER_TOP)
        elif line.region in numbers:
            number = numbers[line.region]
        else:
            continue
        placed.append((number, s, line))
    best: tuple[int, float, float, list[tuple[int, float, _Line]]] | None = None
    for (i, s, _), (j, t, _) in itertools.combinations(placed, 2):
        if i == j:
            continue
        tread = (t - s) / (j - i)
        if not TREAD_M[0] <= tread <= TREAD_M[1]:
            continue
        even = [p for p in placed if abs(p[1] - s - (p[0] - i) * tread) < PLACE_M]
        count = len({number for number, _, _ in even})
        if best is None or count > best[0]:
            best = count, s - i * tread, tread, even
    if best is None:
        return None
    _, s0, tread, even = best
    even = _longest(even)
    seen = [number for number, _, _ in even]
    low, high = min(seen) - 1, max(seen)
    left = np.cross(up, direction)
    spans = np.array([np.sort(line.ends @ left) for _, _, line in even])
    common = spans[:, 0].max(), spans[:, 1].min()
    least = LEAST_COMMON * float(np.min(spans[:, 1] - spans[:, 0]))
    if common[1] - common[0] < least:
        return None
    levels = []
    for k, number in numbers.items():
        along, across = regions[k].outline @ direction, regions[k].outline @ left
        after = along.min() > s0 + number * tread - PLACE_M
        before = along.max() < s0 + (number + 1) * tread + PLACE_M
        beside = min(across.max(), common[1]) - max(across.min(), common[0]) < least
        inside = number <= low or (after and (before or number >= high))
        if inside and not beside:
            levels.append((k, number))
    numbers_seen = {number for _, number in levels} | set(seen)
    if max(numbers_seen) - min(numbers_seen) >= len(numbers_seen) + MOST_MISSING:
        return None
    nosings = tuple(
        Nosing(
            line.region,
            number,
            line.ends,
            line.middle,
            line.covariance,
            line.shared_m,
            line.is_riser,
        )
        for number, _, line in even
    )
    return Match(tuple(levels), nosings, yaw, s0, tread, base, riser)
