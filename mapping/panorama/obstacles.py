"""Obstacles of a panorama from left to right, and the gaps between them.

This is the output of the panoramic map: the complexity measure and the fuzzy selection of an avoidance
motion need nothing else. `sizes` computes it.

Angles are azimuths in the base frame, positive to the LEFT, as everywhere outside `sphere` (theta of seed
004 has the opposite sign). Edges are positions on the floor plane, x ahead and y left, relative to the
origin of the base frame.

Source: Kang 2013 (seed 004), section 2.3, eq. (14) to (20).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from perception.primitives.errors import InputError

SEEN_M = 0.03  # ours: a corner known to within this is seen; its standard deviation is then 7 mm


@dataclass(frozen=True)
class PanoramaObstacle:
    """One obstacle on the floor within the farthest level.

    Args:
        left_rad, right_rad: Azimuth of its left and right edge, left positive; left_rad >= right_rad.
        distance_m: Forward distance d of its nearest part from the base's origin, along x.
        width_m: Lateral distance of its seen edges, along y.
        height_m: Height of its top above the floor.
        sigma_left_rad, sigma_right_rad, sigma_distance_m, sigma_width_m, sigma_height_m: Standard
            deviations.
        left_edge_m, right_edge_m: (x, y) of the edges, base frame.
        label: Its label in the panorama, from 1.
        levels: First and last level set it lies in, from 1; the nearest part lies in the first.
        pixels: Number of its pixels in the panorama.
        hidden_left_m, hidden_right_m: How far it may extend at most beyond that edge, along y, behind what is
            seen of it; 0 for a corner that is seen (see `hidden_corners`).
        cut_left, cut_right: Whether a nearer obstacle or the end of the panorama cuts that edge: the
            width is then a lower bound.
        cut_top: Whether its top is beyond the panorama or above the highest obstacle height.
    """

    left_rad: float
    right_rad: float
    distance_m: float
    width_m: float
    height_m: float
    sigma_left_rad: float = 0.0
    sigma_right_rad: float = 0.0
    sigma_distance_m: float = 0.0
    sigma_width_m: float = 0.0
    sigma_height_m: float = 0.0
    left_edge_m: tuple[float, float] = (math.nan, math.nan)
    right_edge_m: tuple[float, float] = (math.nan, math.nan)
    label: int = 0
    levels: tuple[int, int] = (0, 0)
    pixels: int = 0
    hidden_left_m: float = 0.0
    hidden_right_m: float = 0.0
    cut_left: bool = False
    cut_right: bool = False
    cut_top: bool = False

    def __post_init__(self) -> None:
        if not self.left_rad >= self.right_rad:
            raise InputError(
                f"panorama obstacle: left_rad={self.left_rad} must not be less than "
                f"right_rad={self.right_rad}; azimuths are positive to the left"
            )
        if not (self.distance_m > 0.0 and self.width_m >= 0.0):
            raise InputError(
                f"panorama obstacle: distance_m={self.distance_m} must be positive and "
                f"width_m={self.width_m} not negative"
            )

    @property
    def bearing_rad(self) -> float:
        """Azimuth of its centre, left positive."""
        return 0.5 * (self.left_rad + self.right_rad)

    def expected_edge(self, left: bool) -> tuple[float, float]:
        """y of the left or right end and its standard deviation, m, with what may be hidden beyond the edge.

        The hidden part has a density that falls linearly to zero at its greatest length.
        """
        sign, angle, sigma, edge, hidden = (
            (1.0, self.left_rad, self.sigma_left_rad, self.left_edge_m, self.hidden_left_m)
            if left
            else (
                -1.0,
                self.right_rad,
                self.sigma_right_rad,
                self.right_edge_m,
                self.hidden_right_m,
            )
        )
        sideways = edge[0] * sigma / math.cos(angle) ** 2
        spread = math.hypot(sideways, self.sigma_distance_m * math.tan(angle))
        return edge[1] + sign * hidden / 3.0, math.hypot(spread, hidden / math.sqrt(18.0))

    @staticmethod
    def across(
        left_m: float, right_m: float, distance_m: float, height_m: float
    ) -> PanoramaObstacle:
        """A face perpendicular to x, known exactly: from y = left_m to y = right_m at x = distance_m."""
        return PanoramaObstacle(
            left_rad=math.atan2(left_m, distance_m),
            right_rad=math.atan2(right_m, distance_m),
            distance_m=distance_m,
            width_m=left_m - right_m,
            height_m=height_m,
            left_edge_m=(distance_m, left_m),
            right_edge_m=(distance_m, right_m),
        )


@dataclass(frozen=True)
class PanoramaGap:
    """Free space between two neighbouring obstacles, or between the outermost one and the panorama's end.

    Args:
        left, right: Index in `Surroundings.obstacles` of the neighbour on that side; None at an end.
        left_rad, right_rad: Azimuths of its sides, left positive.
        width_m: Expected passable width, along y; positive. NaN at an end: nothing that was listed bounds it.
        sigma_width_m: Its standard deviation, with the uncertainty of hidden corners; NaN without a width.
        hidden_m: Width that hidden corners take away at most: without them the gap is `hidden_m / 3` wider than
            `width_m`. They never make it wider.
        corners_seen: How many of the two corners that bound it are seen, to within `SEEN_M`.
        distance_m: Forward distance of the farther neighbour.
    """

    left: int | None
    right: int | None
    left_rad: float
    right_rad: float
    width_m: float
    sigma_width_m: float
    hidden_m: float
    corners_seen: int
    distance_m: float


@dataclass(frozen=True)
class Surroundings:
    """All obstacles round the robot and the gaps between them, from left to right.

    Args:
        obstacles: Sorted by falling azimuth of their centres.
        gaps: From left to right; neighbours that overlap along y leave none.
    """

    obstacles: tuple[PanoramaObstacle, ...]
    gaps: tuple[PanoramaGap, ...]

    def __len__(self) -> int:
        return len(self.obstacles)


def gaps_between(
    obstacles: tuple[PanoramaObstacle, ...], ends_rad: tuple[float, float], farthest_m: float
) -> tuple[PanoramaGap, ...]:
    """The gaps of obstacles that are sorted from left to right.

    Args:
        obstacles: Sorted by falling azimuth.
        ends_rad: Azimuths of the panorama's left and right end.
        farthest_m: Only obstacles up to this distance bound a gap.

    The passable width is the lateral distance of the two edges, less the expected part of hidden corners. The
    printed width, `d (tan theta_L - tan theta_R)` with the larger d, agrees for neighbours at one distance and
    is too large for others, as it extends the nearer edge to the farther distance. At the ends it is `d (tan
    end - tan edge)`, the width of the view and not of free space; ours is open there.

    Source: seed 004, eq. (20).
    """
    near = [k for k, obstacle in enumerate(obstacles) if obstacle.distance_m <= farthest_m]
    if not near:
        return ()
    found = []
    for one, other in zip([None, *near], [*near, None], strict=True):
        left = None if one is None else obstacles[one]
        right = None if other is None else obstacles[other]
        bounds = [o for o in (left, right) if o is not None]
        begin = ends_rad[0] if left is None else left.right_rad
        end = ends_rad[1] if right is None else right.left_rad
        if left is None or right is None:
            width, sigma = math.nan, math.nan
            free = begin > end
        else:
            sides = left.expected_edge(False), right.expected_edge(True)
            width, sigma = sides[0][0] - sides[1][0], math.hypot(sides[0][1], sides[1][1])
            free = width > 0.0
        if not free:
            continue
        hidden = [] if left is None else [left.hidden_right_m]
        hidden += [] if right is None else [right.hidden_left_m]
        gap = PanoramaGap(
            one,
            other,
            begin,
            end,
            width,
            sigma_width_m=sigma,
            hidden_m=sum(hidden),
            corners_seen=sum(length <= SEEN_M for length in hidden),
            distance_m=max(o.distance_m for o in bounds),
        )
        found.append(gap)
    return tuple(found)
