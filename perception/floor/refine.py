"""From a rough plane to the best one: weighted least squares, with the covariance that follows.

A depth error moves a point along its ray; seen from height h at depth z that is h/z of it across the floor.
Each point is weighed by that. The formal covariance of ten thousand points is far too small to be true,
because sensors err together: a systematic part is added (ours).

Source: seed 003, Fig. 4, step 5; parameters of the error as in `Plane`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..primitives.plane import Plane
from . import _kernels


@dataclass(frozen=True)
class RefineConfig:
    """Passes, gate and what the sensor errs as a whole."""

    passes: int = 3  # ours: the third changes nothing any more
    reach: float = 2.5  # ours: deviations within which a point counts
    own_m: float = 0.004  # ours: unevenness of a floor, joints, carpet
    systematic_tilt_deg: float = 0.12  # ours: of TOF and RGB-D cameras, by their errors against truth
    systematic_offset_m: float = 0.002  # ours: likewise


def fit(
    points: Float[np.ndarray, "n 3"],
    sigma: Float[np.ndarray, "n"],
    rough: Plane,
    config: RefineConfig,
) -> tuple[Plane, int] | None:
    """The least-squares plane near a rough one.

    Args:
        points: Camera frame, m.
        sigma: Deviation of each z, m.
        rough: Where to begin.
        config: Passes and gate.

    Returns:
        The plane with covariance and the number of points it rests on; None if they do not fix a plane.
    """
    plane, count = rough, 0
    A = np.zeros((3, 3))
    total = 0.0
    for _ in range(config.passes):
        t0, t1 = plane.tangents
        A, b, total, count = _kernels.normal_equations(
            points, sigma, plane.normal, plane.offset_m, t0, t1, config.own_m, config.reach
        )
        if count < 12 or np.linalg.cond(A) > 1e12:
            return None
        a, c, offset = np.linalg.solve(A, b)
        normal = plane.normal + a * t0 + c * t1
        length = float(np.linalg.norm(normal))
        plane = Plane(normal / length, (plane.offset_m + float(offset)) / length)
    spread = max(1.0, total / max(count - 3, 1))  # points noisier than they claim
    tilt = math.radians(config.systematic_tilt_deg)
    systematic = np.diag([tilt**2, tilt**2, config.systematic_offset_m**2])
    return Plane(plane.normal, plane.offset_m, np.linalg.inv(A) * spread + systematic), count
