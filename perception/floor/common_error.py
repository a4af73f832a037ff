"""Covariance of a fitted plane by the error that its points share: distortion of depth.

Distortion turns a plane mostly into another plane, which leaves no residual. Its size is the published or calibrated
one, times a factor by the part that a plane cannot hide: the bend that is left in the residuals of this very view. A
sensor that bends more than its kind shows it there.

Source: ours; the factor is the mean of an inverse gamma posterior, the published size counting as much as
`PRIOR_SHAPES` visible shapes.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from ..depth.distortion import Distortion
from . import _fit_kernels as kernels

LOCAL_SHARE = (
    0.25  # ours: ripples of some degrees, as a share of the smooth distortion (Clarkson 2013)
)
PRIOR_SHAPES = (
    3.0  # ours: the published size weighs as much as the three quadratic shapes of a view
)
MOST_FACTOR = 4.0  # ours: a residual beyond is no bend of a sensor but a floor that is not flat
BLOCK = 2  # image cells along a side that share a ripple: 10 deg


def common_covariance(
    cells: Float[np.ndarray, "m 9"],
    inverse: Float[np.ndarray, "3 3"],
    change: Float[np.ndarray, "3"],
    rho: float,
    slope: Float[np.ndarray, "3"],
    distortion: Distortion,
    edge: float,
) -> Float[np.ndarray, "3 3"]:
    """Covariance of the slope a = -n / rho of a plane, by distortion.

    Args:
        cells: Sums over image cells, see `_fit_kernels.statistics`.
        inverse: Of the normal matrix of the fit.
        change: The last change of the slope; the sums were taken before it.
        rho: Distance of the plane of the sums, m.
        slope: Of the fitted plane.
        distortion: Of the sensor.
        edge: Ray slope of the image's left and right edge.
    """
    index = np.flatnonzero(cells[:, 3] > 0.0)
    used = cells[index]
    w = used[:, 6]
    rays = used[:, 4:7] / w[:, None]
    q = rays @ slope  # of the plane: the noise of measured depth would pass for a bend
    sigma = used[:, 8] / w / q**2
    field = distortion.field(rays[:, 0], rays[:, 1], 1.0 / q, sigma, edge) * q[:, None]
    if not field.shape[1]:
        return np.zeros((3, 3))
    local = LOCAL_SHARE * distortion.size(1.0 / q, sigma) * q
    response = inverse @ (w[:, None] * rays).T
    smooth = response @ field
    rows, columns = np.divmod(index, kernels.CELLS)
    block = (rows // BLOCK) * kernels.CELLS + columns // BLOCK
    _, block = np.unique(block, return_inverse=True)
    ripples = np.zeros((3, int(block.max()) + 1))
    for axis in range(3):
        ripples[axis] = np.bincount(block, response[axis] * local)
    residual = used[:, 2] / rho / w - rays @ change
    visible = field - rays @ smooth  # what the plane cannot take up
    factor = _factor(visible, residual, 1.0 / w + local**2)
    return np.asarray(factor * (smooth @ smooth.T + ripples @ ripples.T))


def _factor(
    visible: Float[np.ndarray, "m k"],
    residual: Float[np.ndarray, "m"],
    variance: Float[np.ndarray, "m"],
) -> float:
    """Variance of the distortion in units of the published one, by the residuals of the cells.

    Each eigenvector of the information J is one visible shape: its score has the variance l + l^2 if the size is the
    published one, and counts by its share of signal l / (1 + l).
    """
    weighted = visible / variance[:, None]
    lengths, vectors = np.linalg.eigh(visible.T @ weighted)
    scores = vectors.T @ (weighted.T @ residual)
    lengths = np.maximum(lengths, 0.0)
    signal = lengths / (1.0 + lengths)
    seen = float(np.sum(signal * scores**2 / np.maximum(lengths + lengths**2, 1e-12)))
    return min((PRIOR_SHAPES + seen) / (PRIOR_SHAPES + float(signal.sum())), MOST_FACTOR)
