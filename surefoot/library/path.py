"""A path over an occupancy map."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float

from perception.primitives.errors import InputError
from perception.primitives.robot_model import DARWIN_OP, RobotModel
from planning.search import astar
from planning.search.potential import SearchConfig

from . import checks
from .checks import ArrayLike


def find_path(
    occupancy: ArrayLike,
    cell_m: float,
    start: ArrayLike,
    goal: ArrayLike,
    *,
    origin: ArrayLike = (0.0, 0.0),
    robot: RobotModel = DARWIN_OP,
    smooth: bool = False,
    **settings: Any,
) -> Float[np.ndarray, "n 2"] | None:
    """The cheapest path of a walking robot over an occupancy map, with shortcuts.

    A cell costs its length times 1 + alpha U, where the potential U rises from 0 at 0.3 m from an obstacle to 1.
    Cells nearer to an occupied one than the robot's radius are never entered.

    Args:
        occupancy: (rows, columns), probability in [0, 1] that a cell is occupied, or booleans; NaN for unknown.
            Rows count along y, columns along x.
        cell_m: Side of a cell, m.
        start, goal: (2,), x and y, m. A start or goal too near to an obstacle moves to the nearest free cell. A
            goal outside the map is approached up to the border.
        origin: (2,), lower left corner of cell [0, 0], m.
        robot: Its size scales the distances.
        smooth: Round the corners to arcs that the gait can walk.
        settings: Fields of `planning.search.potential.SearchConfig`, such as alpha, margin_m, p_unknown.

    Returns:
        (n, 2), waypoints from start to goal, m; None if no path exists.

    Raises:
        InputError: The map is not of this form, a point is not finite, the start lies outside the map, or a
            setting is impossible.

    Source: seed 003, section 3 (potential, A*, shortcuts).
    """
    expected = "(rows, columns) of booleans, or of probabilities in [0, 1] with NaN for unknown"
    cells = checks.array(occupancy, "occupancy", expected, "fb", (2,))
    probability = cells.astype(np.float64)
    unknown = np.isnan(probability)
    if (probability < 0.0).any() or (probability > 1.0).any():
        raise InputError(
            f"occupancy lies in [{np.nanmin(probability):g}, {np.nanmax(probability):g}]; expected {expected}"
        )
    config = checks.configured(SearchConfig, settings, "find_path")
    rounded = checks.flag(smooth, "smooth")
    found = astar.find_path(
        np.where(unknown, config.p_unknown, probability),
        unknown,
        checks.numbers(origin, (2,), "origin"),
        checks.positive(cell_m, "cell_m"),
        checks.numbers(start, (2,), "start"),
        checks.numbers(goal, (2,), "goal"),
        config,
        checks.instance(robot, RobotModel, "robot"),
    )
    if found is None:
        return None
    return found.curve if rounded else found.waypoints
