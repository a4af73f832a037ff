"""Whether a truth lies in the predicted region: the highest-density region of a Gaussian mixture.

Source: Hyndman, "Computing and graphing highest density regions", The American Statistician 50 (1996), section 3.2.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

SAMPLES = 400  # ours: the share of a region of 90 % is 90 +- 1.5 % then


def in_region(
    place: Float[np.ndarray, "d"],
    weights: Float[np.ndarray, "m"],
    means: Float[np.ndarray, "m d"],
    covariances: Float[np.ndarray, "m d d"],
    share: float,
    rng: np.random.Generator,
) -> bool:
    """Whether a place lies in the smallest region that holds a share of the mixture.

    Args:
        place: The truth.
        weights, means, covariances: Of the parts; weights need not add up to 1.
        share: Probability of the region.
        rng: Draws the samples by which its border is found.
    """
    counts = weights > 0.0
    weights, means = weights[counts] / weights.sum(), means[counts]
    factors = np.linalg.cholesky(covariances[counts])
    drawn = rng.choice(len(weights), SAMPLES, p=weights)
    noise = rng.standard_normal((SAMPLES, len(place), 1))
    samples = means[drawn] + (factors[drawn] @ noise)[..., 0]
    points = np.vstack([samples, place])
    off = points[:, None, :] - means
    white = np.linalg.solve(factors[None], off[..., None])[..., 0]
    scale = np.prod(np.diagonal(factors, axis1=1, axis2=2), axis=1)
    density = (weights / scale * np.exp(-0.5 * np.square(white).sum(axis=2))).sum(axis=1)
    return bool(density[-1] >= np.quantile(density[:-1], 1.0 - share))
