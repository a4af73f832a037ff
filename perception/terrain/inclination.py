"""Inclination of regions: level, a ramp, or upright, as far as the uncertainty of up and of the plane allows.

Source: ours.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float

from ..primitives.plane import Plane
from .region import Region

SIGMAS = 3.0  # ours
RAMP_RAD = (math.radians(2.0), math.radians(35.0))
"""Ours: least and greatest slope of a ramp: treads of stairs fall by 1 deg at most, and steeper is no ground."""
FILLED = 0.5  # ours: share of its outline that a ramp fills; a plane through far stairs has stripes of each
SMALLEST_STEP_M = (0.10, 0.21)  # building codes: riser and tread; smaller steps are a ramp
NOTICED_SIGMAS = 2.0  # ours: of noise, by which such steps would stand out of the plane
RAMP_M = 0.45  # ours: length along the slope; a shorter one may be a tread, seen crooked


def inclination(region: Region, prior: Plane) -> tuple[float, float]:
    """Angle between a region and the horizontal, and its standard deviation, rad.

    Args:
        region: The region.
        prior: Predicted floor, camera frame, with the covariance of its tilt.
    """
    tilt = (
        prior.tangents @ region.plane.normal
    )  # of the region's normal, about the prior's tangents
    size = float(np.linalg.norm(tilt))
    way = tilt / size if size > 0.0 else np.array([1.0, 0.0])
    turn = way @ prior.tangents @ region.plane.tangents.T
    variance = way @ prior.covariance[:2, :2] @ way + turn @ region.plane.covariance[:2, :2] @ turn
    return region.slope_rad(prior.normal), math.sqrt(float(variance))


def ramps(regions: list[Region], prior: Plane) -> list[int]:
    """Indices of the regions that are certainly inclined and still ground: ramps.

    Of stairs seen along their pitch only the nosings are visible, and pixels and noise hide small steps. A plane of which
    that may hold is no ramp for sure.
    """
    found = []
    for index, one in enumerate(regions):
        angle, sigma = inclination(one, prior)
        inclined = angle - SIGMAS * sigma > RAMP_RAD[0] and angle < RAMP_RAD[1]
        along = prior.normal - (prior.normal @ one.plane.normal) * one.plane.normal
        along = along / max(float(np.linalg.norm(along)), 1e-9)
        long = np.ptp(one.outline @ along) >= RAMP_M
        if inclined and long and one.area_m2 >= FILLED * _area(one.outline) and _smooth(one):
            found.append(index)
    return found


def _smooth(region: Region) -> bool:
    """Whether the smallest steps would be noticed: as far as they are seen, their depth below the nosings is uniform."""
    riser, tread = SMALLEST_STEP_M
    pitch = math.hypot(riser, tread)
    incidence = region.plane.offset_m / float(np.linalg.norm(region.middle))  # sine
    if pitch * incidence < region.detail_m:
        return False
    deepest = min(pitch * incidence, riser * tread / pitch)
    return deepest / math.sqrt(12.0) > NOTICED_SIGMAS * region.noise_m


def _area(outline: Float[np.ndarray, "m 3"]) -> float:
    """Area of a flat polygon, m^2."""
    away = outline - outline[0]
    return float(np.linalg.norm(np.cross(away, np.roll(away, -1, axis=0)).sum(axis=0))) / 2.0
