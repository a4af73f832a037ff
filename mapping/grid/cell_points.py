"""The points of a frame in the cells of a window: the number of each kind, and the sums of their heights."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int, Int32

from perception.primitives.errors import InputError

from . import _terrain_kernels


def check_one_a_point(
    what: str,
    points: Float[np.ndarray, "n d"],
    is_obstacle: np.ndarray,
    is_moving: np.ndarray | None,
    sigma_m: np.ndarray | None,
) -> None:
    """Refuse flags or standard deviations of another number than the points.

    Raises:
        InputError: So it is; `what` names the map.
    """
    given = {"flags": is_obstacle, "moving flags": is_moving, "sigmas": sigma_m}
    for name, values in given.items():
        if values is not None and len(values) != len(points):
            raise InputError(
                f"{what} update: {len(points)} points but {len(values)} {name}; give one a point"
            )


def gather(
    points: Float[np.ndarray, "n 3"],
    is_obstacle: Bool[np.ndarray, "n"],
    is_moving: Bool[np.ndarray, "n"] | None,
    sigma_m: Float[np.ndarray, "n"] | None,
    anchor: Float[np.ndarray, "2"],
    per_m: float,
    first: Int[np.ndarray, "2"],
    shape: tuple[int, int],
    tally: Int32[np.ndarray, "t"],
    sums: Float[np.ndarray, "t 3"],
) -> None:
    """Count the points of each kind in each cell of a window, and sum heights, squared heights and variances.

    Args:
        points: x, y and height, m; NaN and points outside the window are left aside.
        is_obstacle, is_moving: Kind of each point; without `is_moving` no obstacle moves.
        sigma_m: Standard deviation of each; None: without noise.
        anchor: Lower left corner of lattice cell (0, 0), m.
        per_m: Cells per metre.
        first: Lattice cell (x, y) of the window's corner.
        shape: Rows and columns of the window.
        tally, sums: As of `_terrain_kernels.gather`, all zero; filled.
    """
    _terrain_kernels.gather(
        np.ascontiguousarray(points, np.float64).reshape(-1),
        np.ascontiguousarray(is_obstacle).view(np.uint8),
        np.zeros(0, np.uint8)
        if is_moving is None
        else np.ascontiguousarray(is_moving).view(np.uint8),
        np.zeros(0) if sigma_m is None else np.ascontiguousarray(sigma_m, np.float64),
        anchor,
        per_m,
        first,
        *shape,
        tally,
        sums,
    )
