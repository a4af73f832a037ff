"""What stands around, as the panorama tells it: obstacles from left to right, and the gaps between them.

This is what the panoramic map hands to planning: for the complexity measure and the fuzzy selection of a
motion nothing else is needed. `sizes` makes it from a drawn panorama.

Angles are azimuths in the base frame, positive to the LEFT, as everywhere outside `sphere` (seed 004's
theta is minus this); edges are places on the floor plan, x ahead and y left, seen from the base's origin.

Source: seed 004, section 2.3, eq. (14) to (20).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from perception.primitives.errors import InputError


@dataclass(frozen=True)
class PanoramaObstacle:
    """One thing that stands on the floor within the farthest level.

    Args:
        left_rad, right_rad: Azimuth of its left and right edge, left positive; left_rad >= right_rad.
        distance_m: Forward distance d of its nearest part from the base's origin (along x, not along the
            ray).
        width_m: Across the way (along y), between both edges.
        height_m: Of its top above the floor.
        sigma_left_rad, sigma_right_rad, sigma_distance_m, sigma_width_m, sigma_height_m: Deviations.
        left_edge_m, right_edge_m: (x, y) of the edges, base frame.
        label: Its number in the panorama's labels of obstacles, from 1.
        levels: First and last level set it lies in, from 1; the nearest part lies in the first.
        pixels: How many pixels of the panorama show it.
        cut_left, cut_right: Whether the edge is not its own, as it goes on behind something nearer or
            beyond the panorama: width is then what is seen of it, a lower bound.
        cut_top: Whether its top is beyond the panorama or above what counts as an obstacle.
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
        """Azimuth of its middle, left positive."""
        return 0.5 * (self.left_rad + self.right_rad)

    @staticmethod
    def across(
        left_m: float, right_m: float, distance_m: float, height_m: float
    ) -> PanoramaObstacle:
        """A face across the way, known exactly: from y = left_m to y = right_m at x = distance_m."""
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
    """Free way between two neighbours, or between the last one and where the panorama (or a wall) ends.

    Args:
        left, right: Index in `Surroundings.obstacles` of the neighbour on that side; None at an end.
        left_rad, right_rad: Azimuths it lies between, left positive.
        width_m: Passable width, across the way (along y); not positive where neighbours overlap.
        sigma_width_m: Its deviation.
        distance_m: Forward distance of the farther one of the two.
    """

    left: int | None
    right: int | None
    left_rad: float
    right_rad: float
    width_m: float
    sigma_width_m: float
    distance_m: float


@dataclass(frozen=True)
class Surroundings:
    """All obstacles, and all gaps between them, from left to right.

    Args:
        obstacles: By the azimuth of their middle, falling.
        gaps: One more than there are obstacles if both ends count, `gaps[0]` left of all of them.
    """

    obstacles: tuple[PanoramaObstacle, ...]
    gaps: tuple[PanoramaGap, ...]

    def __len__(self) -> int:
        return len(self.obstacles)

    def gap_beside(self, index: int, left: bool) -> PanoramaGap | None:
        """The gap on one side of an obstacle; None if there is none that counts."""
        for gap in self.gaps:
            if (gap.right if left else gap.left) == index:
                return gap
        return None


def gaps_between(
    obstacles: tuple[PanoramaObstacle, ...], ends_rad: tuple[float, float], farthest_m: float
) -> tuple[PanoramaGap, ...]:
    """The gaps of obstacles that are sorted from left to right.

    Args:
        obstacles: By azimuth, falling.
        ends_rad: Azimuths of the panorama's left and right end.
        farthest_m: A gap counts only if both its neighbours are nearer.

    The passable width is what lies between the two edges across the way; the printed one, `d (tan theta_L -
    tan theta_R)` with the larger d, is the same for neighbours at one distance and too wide for others,
    as it stretches the nearer edge to the farther's distance. At the ends it is `d (tan end - tan edge)`.

    Source: seed 004, eq. (20).
    """
    if not obstacles:
        return ()
    near = [k for k, obstacle in enumerate(obstacles) if obstacle.distance_m <= farthest_m]
    found = []
    for one, other in zip([None, *near], [*near, None], strict=True):
        left = None if one is None else obstacles[one]
        right = None if other is None else obstacles[other]
        d = max(o.distance_m for o in (left, right) if o is not None) if near else 0.0
        if left is not None and right is not None:
            width = left.right_edge_m[1] - right.left_edge_m[1]
            sigma = math.hypot(_across(left, False), _across(right, True))
            ends = left.right_rad, right.left_rad
        elif right is not None:
            ends = ends_rad[0], right.left_rad
            width = right.left_edge_m[0] * (_tangent(ends_rad[0]) - math.tan(right.left_rad))
            sigma = _across(right, True)
        elif left is not None:
            ends = left.right_rad, ends_rad[1]
            width = left.right_edge_m[0] * (math.tan(left.right_rad) - _tangent(ends_rad[1]))
            sigma = _across(left, False)
        else:
            continue
        found.append(PanoramaGap(one, other, ends[0], ends[1], width, sigma, d))
    return tuple(found)


def _across(obstacle: PanoramaObstacle, left: bool) -> float:
    """Deviation of one edge's y, m."""
    angle, sigma, edge = (
        (obstacle.left_rad, obstacle.sigma_left_rad, obstacle.left_edge_m)
        if left
        else (obstacle.right_rad, obstacle.sigma_right_rad, obstacle.right_edge_m)
    )
    return math.hypot(
        edge[0] * sigma / math.cos(angle) ** 2, obstacle.sigma_distance_m * math.tan(angle)
    )


def _tangent(angle_rad: float) -> float:
    """Tangent, held below a right angle, where a way across has no end."""
    limit = math.radians(85.0)
    return math.tan(min(max(angle_rad, -limit), limit))
