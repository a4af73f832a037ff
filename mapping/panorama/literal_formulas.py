"""The formulas of seed 004's section 2.3 as they are printed, for the numbers they give.

They count pixels as if the panorama were one flat image of the camera: a width comes out short by 4 to 12 %
on a sphere of the camera's own scale, the wider the shorter. Distance leaves out the pitch, which costs 5 %
at 17 deg. Levels round range down to whole metres first, so that only every twentieth of them is ever used.
`SizeConfig.literal` measures distance, width, height and gaps with them, of things that are parted as by
default: `levels` only tells what the printed ones would be. The default is what they should have been.

Source: seed 004, eq. (13), (15) to (20).
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float, Int

ACROSS_RAD, DOWN_RAD = math.radians(44.0), math.radians(35.0)  # seed 004: the camera's view
ACROSS_PX, DOWN_PX = 176, 144  # seed 004: its pixels
ACROSS_PX_PER_RAD, DOWN_PX_PER_RAD = ACROSS_PX / ACROSS_RAD, DOWN_PX / DOWN_RAD
"""Grain of its grid on a sphere: pixels to count for an angle, however finely the panorama is drawn."""


def levels(range_m: Float[np.ndarray, "*n"], step_m: float = 0.05) -> Int[np.ndarray, "*n"]:
    """`floor(floor(z) / dd)`, eq. (13); -1 where there is no range."""
    whole = np.floor(np.nan_to_num(range_m, nan=-1.0))
    return np.where(whole < 0.0, -1, np.floor(whole / step_m + 1e-9)).astype(np.int64)


def distance(range_m: float, theta_rad: float) -> float:
    """`d = z cos(theta)`, eq. (15), m."""
    return range_m * math.cos(theta_rad)


def width(distance_m: float, columns: float) -> float:
    """`w = 2 tan(theta_FOV / 2) d #p_w / #p_wFOV`, eq. (16) and (18), m; a gap likewise, eq. (20)."""
    return 2.0 * math.tan(ACROSS_RAD / 2.0) * distance_m * columns / ACROSS_PX


def height(distance_m: float, rows: float) -> float:
    """`h = 2 tan(phi_FOV / 2) d #p_h / #p_hFOV`, eq. (17) and (19), m."""
    return 2.0 * math.tan(DOWN_RAD / 2.0) * distance_m * rows / DOWN_PX
