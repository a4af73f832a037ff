"""Gaussian-Hermite moments around a pixel: image derivatives that are robust to noise.

The Gaussian-Hermite functions are orthonormal on the real line, and nearly so when sampled on a mask as wide as
the support of the highest order. A moment of odd order in x and order 0 in y is a smooth derivative along x;
orders 1, 3 and 5 together are a gradient with a larger support than pixel differences.

`p` and `q` are the orders along x (columns) and y (rows, downwards); a mask has an odd side M, its coordinate
runs over [-1, 1], and sigma in that unit is `sigma_px / ((M - 1) / 2)`.

Source: Kang et al. 2013 (seed 004), eq. (1) to (10); (1) after Yang and Dai 2011, (4) centred for odd masks.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from jaxtyping import Float, Float32

from ..primitives.errors import ConfigError

ODD_ORDERS = (1, 3, 5)
"""The orders whose sum of squares is the magnitude, eq. (8)."""


def gaussian_hermite(
    order: int, x: Float[np.ndarray, "*n"], sigma: float
) -> Float[np.ndarray, "*n"]:
    """The orthonormal function `(2^p p! sqrt(pi) sigma)^(-1/2) exp(-x^2 / 2 sigma^2) H_p(x / sigma)`.

    Args:
        order: p, 0 or more.
        x: Coordinates, in the unit of sigma.
        sigma: Width, positive.

    Source: seed 004, eq. (1).
    """
    if order < 0 or not sigma > 0.0:
        raise ConfigError(
            f"gaussian_hermite: order={order} must be 0 or more and sigma={sigma} positive"
        )
    s = x / sigma
    before, hermite = np.zeros_like(s), np.ones_like(s)
    for n in range(order):
        before, hermite = hermite, 2.0 * s * hermite - 2.0 * n * before
    scale = 1.0 / math.sqrt(2.0**order * math.factorial(order) * math.sqrt(math.pi) * sigma)
    return np.asarray(scale * np.exp(-0.5 * s * s) * hermite)


def mask_side(sigma_px: float, highest_order: int = 5) -> int:
    """M, the side of the mask, px, odd. Source: seed 004, eq. (10)."""
    return 2 * round(sigma_px * highest_order) + 1


def mask_coordinates(side: int) -> Float[np.ndarray, "m"]:
    """Coordinates of a mask's pixels on [-1, 1]. Source: seed 004, eq. (5)."""
    if side < 3 or side % 2 == 0:
        raise ConfigError(f"gaussian_hermite: side={side} must be odd and at least 3")
    return (2.0 * np.arange(side) - side + 1.0) / (side - 1.0)


def mask(order: int, sigma_px: float, side: int, interval: int = 1) -> Float[np.ndarray, "m"]:
    """One axis of a moment's mask; moments are correlations with two of them.

    Args:
        order: p or q.
        sigma_px: Width, px; below 1.6 the sampled functions are no longer orthonormal.
        side: M, px, odd.
        interval: m_M, sampling interval, px; other pixels are zero, and the mask is multiplied by the interval to
            keep its scale. It should divide M - 1, or the mask is not centred.

    Source: seed 004, eq. (3), (6), (7), with sigma in the unit of the mask.
    """
    if interval < 1:
        raise ConfigError(f"gaussian_hermite: interval={interval} must be at least 1")
    half = (side - 1) / 2.0
    values = gaussian_hermite(order, mask_coordinates(side), sigma_px / half) / half
    kept = np.zeros(side)
    kept[::interval] = interval * values[::interval]
    return kept


def moment(
    image: Float32[np.ndarray, "h w"], p: int, q: int, sigma_px: float = 1.6
) -> Float32[np.ndarray, "h w"]:
    """The moment of order (p, q) around every pixel; the border is replicated.

    Args:
        image: Any unit; the moment has the same, times the integral of the mask.
        p: Order along x.
        q: Order along y.
        sigma_px: Width, px; it determines the mask's side for order 5.

    Source: seed 004, eq. (7), as two filters along the axes.
    """
    side = mask_side(sigma_px)
    across, down = mask(p, sigma_px, side), mask(q, sigma_px, side)
    return np.asarray(
        cv2.sepFilter2D(image, cv2.CV_32F, across, down, borderType=cv2.BORDER_REPLICATE)
    )


def gradient(
    image: Float32[np.ndarray, "h w"],
    sigma_px: float = 1.6,
    orders: tuple[int, ...] = ODD_ORDERS,
    first_order: bool = False,
    literal: bool = False,
) -> tuple[Float32[np.ndarray, "h w"], Float32[np.ndarray, "h w"]]:
    """Magnitude and direction of the image gradient by moments of odd order.

    Args:
        image: Any unit.
        sigma_px: Width, px.
        orders: Odd orders; (1, 3, 5) in seed 004.
        first_order: Take the direction from order 1 alone, which rotates with the image exactly; with the sums of
            squares of all orders it is off by up to 8 deg.
        literal: As printed, for comparison: a mask displaced by one pixel, and the arc tangent of the ratio of the
            squares, in [0, pi/2], without quadrant.

    Returns:
        Magnitude, the root of the sum of squares; direction, rad in [-pi, pi], from x (right) towards y (down),
        in the quadrant of order 1.

    Source: seed 004, eq. (8), and (9) with the quadrant kept; (4) and (9) as printed by `literal`.
    """
    if literal:
        image = np.pad(image, ((0, 1), (0, 1)), mode="edge")[1:, 1:]
    x_moments = [moment(image, p, 0, sigma_px) for p in orders]
    y_moments = [moment(image, 0, q, sigma_px) for q in orders]
    x_square = np.sum([m * m for m in x_moments], axis=0)
    y_square = np.sum([m * m for m in y_moments], axis=0)
    if literal:
        angle = np.arctan2(y_square, x_square)
        return np.sqrt(x_square + y_square).astype(np.float32), angle.astype(np.float32)
    if first_order:
        angle = np.arctan2(y_moments[0], x_moments[0])
        return np.sqrt(x_square + y_square).astype(np.float32), angle.astype(np.float32)
    angle = np.arctan2(
        np.copysign(np.sqrt(y_square), y_moments[0]), np.copysign(np.sqrt(x_square), x_moments[0])
    )
    return np.sqrt(x_square + y_square).astype(np.float32), angle.astype(np.float32)
