"""The size formulas of seed 004, section 2.3, as they are printed.

They count pixels as if the panorama were one flat camera image. On a sphere of the camera's own resolution a
width comes out 4 to 12 % too small, and the more the wider it is. Distance ignores the pitch, which costs
5 % at 17 deg. `SizeConfig.literal` applies them to distance, width, height and gaps, for comparison.

Source: Kang 2013 (seed 004), eq. (15) to (20).
"""

from __future__ import annotations

import math

ACROSS_RAD, DOWN_RAD = math.radians(44.0), math.radians(35.0)  # seed 004: field of view
ACROSS_PX, DOWN_PX = 176, 144  # seed 004: its pixels
ACROSS_PX_PER_RAD, DOWN_PX_PER_RAD = ACROSS_PX / ACROSS_RAD, DOWN_PX / DOWN_RAD
"""Pixels to count per angle, independent of the resolution of the panorama."""


def distance(range_m: float, theta_rad: float) -> float:
    """`d = z cos(theta)`, eq. (15), m."""
    return range_m * math.cos(theta_rad)


def width(distance_m: float, columns: float) -> float:
    """`w = 2 tan(theta_FOV / 2) d #p_w / #p_wFOV`, eq. (16) and (18), m; a gap likewise, eq. (20)."""
    return 2.0 * math.tan(ACROSS_RAD / 2.0) * distance_m * columns / ACROSS_PX


def height(distance_m: float, rows: float) -> float:
    """`h = 2 tan(phi_FOV / 2) d #p_h / #p_hFOV`, eq. (17) and (19), m."""
    return 2.0 * math.tan(DOWN_RAD / 2.0) * distance_m * rows / DOWN_PX
