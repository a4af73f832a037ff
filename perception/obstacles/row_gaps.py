"""Level surfaces that are seen at a grazing angle, on a plan of small cells.

The top of a table or a box that is hardly lower than the camera is hit by few rows of pixels, far apart: on a plan of small
cells it would be several objects one behind the other, or too few points to be one. Between two rows nothing was seen, so
they belong together if the farther one shows nothing but a level surface, at the height at which the nearer one ends. What
has no place with enough points, such as a front, is none.

Source: ours.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import ndimage

NEIGHBOURS = np.ones((3, 3), dtype=bool)
LEVEL_M = 0.03  # ours: largest difference in height within a level surface, and between its rows
LONGEST_M = 0.30  # ours: longest gap that is bridged; more would join separate objects
LEAST_ABOVE_M = 0.01  # ours: least height of the sensor above a surface that it sees from above


class Plan(NamedTuple):
    """Points on a plan of cells.

    Args:
        cells: (n,) flat index of the cell of each point.
        shape: Rows and columns.
        origin: Lower left corner: x along the rows, y along the columns, m.
        cell_m: Side of a cell.
    """

    cells: Int[np.ndarray, "n"]
    shape: tuple[int, int]
    origin: Float[np.ndarray, "2"]
    cell_m: float


class Sensor(NamedTuple):
    """Place of a sensor, and its rows of pixels.

    Args:
        xy: In the frame of the points, m.
        height_m: Above the floor.
        pitch_rad: Angle between two rows; 0: not known.
        rim_rad: Angle at either end of an object that has no depth.
    """

    xy: Float[np.ndarray, "2"]
    height_m: float
    pitch_rad: float
    rim_rad: float = 0.0


def with_level(
    heights: Float[np.ndarray, "n"],
    weight: Float[np.ndarray, "n"],
    sensor: Sensor,
    plan: Plan,
    least: float,
) -> tuple[Bool[np.ndarray, "rows columns"], Float[np.ndarray, "rows columns"]]:
    """Cells with enough points, and the level surfaces that join them: their cells and those between two rows.

    Args:
        heights: Of the points above the floor, m.
        weight: Of each point.
        sensor: What saw them.
        plan: Their cells.
        least: Weight of a cell with enough points; a level one has as many times fewer as its rows are farther apart.

    Returns:
        The cells, and the height of the top of every cell, m; -inf without one.
    """
    tops = np.full(math.prod(plan.shape), -np.inf)
    np.maximum.at(tops, plan.cells, heights)
    mass = np.bincount(plan.cells, weight, len(tops))
    found = mass >= least
    enough = found.reshape(plan.shape).copy()
    is_level = mass > 0.0
    is_level[plan.cells[heights < tops[plan.cells] - LEVEL_M]] = False
    level = np.flatnonzero(is_level & (tops < sensor.height_m - LEAST_ABOVE_M))
    places = plan.origin + plan.cell_m * (np.stack(np.divmod(level, plan.shape[1]), axis=1) + 0.5)
    below = sensor.height_m - tops[level]
    ranges = np.sqrt(((places - sensor.xy) ** 2).sum(axis=1) + below**2)
    thick = mass[level] * ranges / below >= least
    gaps = np.minimum(sensor.pitch_rad * ranges[thick] ** 2 / below[thick], LONGEST_M)
    found[level[thick]] = True
    _bridge(found, tops, (level[thick], places[thick], gaps), sensor.xy, plan)
    labels, count = ndimage.label(found.reshape(plan.shape), NEIGHBOURS)
    kept = np.zeros(count + 1, np.bool_)
    kept[labels[enough]] = True
    return kept[labels], tops.reshape(plan.shape)


def _bridge(
    found: Bool[np.ndarray, "cells"],
    tops: Float[np.ndarray, "cells"],
    level: tuple[Int[np.ndarray, "k"], Float[np.ndarray, "k 2"], Float[np.ndarray, "k"]],
    sensor_xy: Float[np.ndarray, "2"],
    plan: Plan,
) -> None:
    """Add to the cells found those between a level one and the next one before it, at the same height, which becomes their top.

    Before it is towards the sensor.

    Args:
        found, tops: Of the cells; changed.
        level: The level cells, their places, m, and the distances to the next row, m.
        sensor_xy: Place of the sensor.
        plan: The cells.
    """
    far, places, gaps = level
    filled = found.copy()
    step = sensor_xy - places
    step *= plan.cell_m / np.maximum(np.hypot(*step.T), plan.cell_m)[:, None]
    passed: list[np.ndarray] = []
    for number in range(1, math.ceil(LONGEST_M / plan.cell_m) + 1):
        there = np.floor((places + number * step - plan.origin) / plan.cell_m).astype(np.int64)
        going = ((there >= 0) & (there < plan.shape)).all(axis=1)
        going &= (number - 1) * plan.cell_m <= gaps
        here = there[:, 0] * plan.shape[1] + there[:, 1]
        here[~going] = far[~going]
        meets = filled[here] & (here != far) & (np.abs(tops[here] - tops[far]) <= LEVEL_M)
        for cells in passed:
            found[cells[meets]] = True
            tops[cells[meets]] = tops[far[meets]]
        going &= ~meets
        far, places, gaps, step = far[going], places[going], gaps[going], step[going]
        passed = [cells[going] for cells in [*passed, here]]
