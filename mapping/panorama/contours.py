"""The outline of one obstacle in a panorama: distance of its front face in every column.

An upright obstacle on the floor is equally far at its base and at the top of its front, so each column of
pixels has one forward distance. All columns together are the outline on the floor plane.

Source: Kang 2013 (seed 004), section 2.3, eq. (15) `d = z cos(phi) cos(theta)`; one distance per column is
ours.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Float32

NEAR_SHARE = 0.15  # ours: the search starts at this quantile of the distances, from the nearest
WINDOW_M = 0.025  # ours: pixels of a front lie this close to it; five standard deviations
LEAST_ROWS = 3  # ours: pixels in a column with a front


def fronts(
    forward_m: Float32[np.ndarray, "h w"],
    sigma_m: Float32[np.ndarray, "h w"],
    mask: Bool[np.ndarray, "h w"],
) -> tuple[Float[np.ndarray, "w"], Float[np.ndarray, "w"]]:
    """Forward distance of the nearest face in every column and its standard deviation, m; NaN without one.

    Starting at the nearest pixels, the mean of the pixels within a window, weighted by inverse variance, is
    iterated. A minimum would be biased forwards by noise, and a plain mean backwards by the top face, which
    extends behind the front. Dark spots have a large variance and hardly count.

    Args:
        forward_m: Forward distance of each pixel.
        sigma_m: Standard deviation of its range.
        mask: Pixels of the obstacle.
    """
    found, sigma = np.full((2, mask.shape[1]), np.nan)
    count = mask.sum(axis=0)
    known = count >= LEAST_ROWS
    if not known.any():
        return found, sigma
    held = np.where(mask, forward_m, np.float32(np.nan))[:, known].astype(np.float64)
    order = np.argsort(held, axis=0)  # NaN last
    held = np.take_along_axis(held, order, axis=0)
    variance = np.take_along_axis(sigma_m[:, known].astype(np.float64), order, axis=0) ** 2
    weight = np.where(np.isfinite(held) & (variance > 0.0), 1.0 / np.maximum(variance, 1e-12), 0.0)
    held = np.nan_to_num(held, nan=1e9)
    total = np.cumsum(weight, axis=0)
    pick = np.argmax(total >= NEAR_SHARE * total[-1], axis=0)
    centre = held[pick, np.arange(pick.size)]
    close = np.zeros_like(weight)
    for _ in range(6):
        close = np.where(np.abs(held - centre) <= WINDOW_M, weight, 0.0)
        centre = (close * held).sum(axis=0) / close.sum(axis=0)
    found[known], sigma[known] = centre, 1.0 / np.sqrt(close.sum(axis=0))
    return found, sigma
