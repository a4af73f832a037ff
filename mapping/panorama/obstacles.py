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


@dataclass(frozen=True)
class PanoramaObstacle:
    """One obstacle on the floor within the farthest level.

    Args:
        left_rad, right_rad: Azimuth of its left and right edge, left positive; left_rad >= right_rad.
        distance_m: Forward distance d of its nearest part from the base's origin, along x.
        width_m: Lateral distance of its edges, along y.
        height_m: Height of its top above the floor.
        sigma_left_rad, sigma_right_rad, sigma_distance_m, sigma_width_m, sigma_height_m: Standard
            deviations.
        left_edge_m, right_edge_m: (x, y) of the edges, base frame.
        label: Its label in the panorama, from 1.
        levels: First and last level set it lies in, from 1; the nearest part lies in the first.
        pixels: Number of its pixels in the panorama.
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
        width_m: Passable lateral width, along y; not positive if the neighbours overlap.
        sigma_width_m: Its standard deviation.
        distance_m: Forward distance of the farther neighbour.
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
    """All obstacles round the robot and the gaps between them, from left to right.

    Args:
        obstacles: Sorted by falling azimuth of their centres.
        gaps: One more than the obstacles within the farthest level; `gaps[0]` is the leftmost.
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

    The passable width is the lateral distance of the two edges. The printed width, `d (tan theta_L -
    tan theta_R)` with the larger d, agrees for neighbours at one distance and is too large for others, as
    it extends the nearer edge to the farther distance. At the ends it is `d (tan end - tan edge)`.

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
    """Standard deviation of y of one edge, m."""
    angle, sigma, edge = (
        (obstacle.left_rad, obstacle.sigma_left_rad, obstacle.left_edge_m)
        if left
        else (obstacle.right_rad, obstacle.sigma_right_rad, obstacle.right_edge_m)
    )
    return math.hypot(
        edge[0] * sigma / math.cos(angle) ** 2, obstacle.sigma_distance_m * math.tan(angle)
    )


def _tangent(angle_rad: float) -> float:
    """Tangent, with the angle limited to 85 deg."""
    limit = math.radians(85.0)
    return math.tan(min(max(angle_rad, -limit), limit))
