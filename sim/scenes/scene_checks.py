"""Checks of a user's scene: everything inside the walls, enough room, and a path to every goal.

Each error states the entry in the file, the problem, and a remedy.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from perception.primitives.errors import InputError

from ..free_space import clearance_map
from ..scene import Extent, FloorArea, MovingObject, Place, StaticObject
from ..shapes import Shape, Solid, distance, outline
from .walker import Walker

ROBOT_RADIUS_M = 0.15  # seed 001: S_r; grows with the breadth of the walker
HALF_WIDTH_M = (
    0.082  # seed 000: half the robot's width, for lateral steps through narrow gaps; likewise
)
LEAST_SIDE_M, MOST_SIDE_M = 1.0, 50.0  # ours: of a room; tags of a larger one take gigabytes
STATIC = ("box", "cylinder", "furniture", "model")
MOST_MOVING, MOST_STATIC = 50, 500  # ours: 50 moving objects of 2.4 m are 2 GB in a renderer
_INTO_WALL_M = 0.02  # ours: tolerated overlap with walls and floor
_FINEST_CELL_M, _COARSEST_CELL_M = 0.02, 0.06  # ours: coarser cells miss thin walls
_CELLS = 500  # ours: along the longer side
_CONVEX = "; models are convex for contact: split a hollow one into convex pieces"


def check_extent(where: str, extent: Extent) -> None:
    """Check that the floor has an area for walking."""
    x0, y0, x1, y1 = extent
    if not (x0 < x1 and y0 < y1):
        raise InputError(
            f"{where}extent = {list(extent)} must be x_min, y_min, x_max, y_max, min < max"
        )
    if not all(LEAST_SIDE_M <= side <= MOST_SIDE_M for side in (x1 - x0, y1 - y0)):
        raise InputError(
            f"{where}extent = {list(extent)} is {x1 - x0:g} x {y1 - y0:g} m; each side must be "
            f"{LEAST_SIDE_M:g} to {MOST_SIDE_M:g} m"
        )


def check_count(where: str, table: Mapping[str, Any]) -> None:
    """Check that a renderer can hold all objects, of which each has a texture of its own."""
    for kinds, most in ((("moving_object",), MOST_MOVING), (STATIC, MOST_STATIC)):
        count = sum(len(table.get(kind, [])) for kind in kinds)
        if count > most:
            listed = ", ".join(f"[[{kind}]]" for kind in kinds)
            raise InputError(f"{where}{count} of {listed}; {most} are the most, leave some out")


def check_area(where: str, area: FloorArea, extent: Extent) -> None:
    """Check that flooring has an area and lies inside the walls."""
    x0, y0, x1, y1 = area.extent
    if x1 - x0 < 0.01 or y1 - y0 < 0.01:
        raise InputError(
            f"{where}extent = {list(area.extent)} must be x_min, y_min, x_max, y_max, each side at "
            "least 0.01 m"
        )
    if not (extent[0] <= x0 and extent[1] <= y0 and x1 <= extent[2] and y1 <= extent[3]):
        raise InputError(
            f"{where}extent = {list(area.extent)} must lie within that of the floor, {list(extent)}; cut it "
            "there"
        )


def check_object(where: str, item: StaticObject, extent: Extent, above_m: float) -> None:
    """Check that an object is inside the walls, and on or above the floor."""
    corners = np.concatenate([outline(part) for part in item.parts])
    low, high = corners.min(axis=0), corners.max(axis=0)
    beyond = float(np.max([np.array(extent[:2]) - low, high - np.array(extent[2:])]))
    if beyond > _INTO_WALL_M:
        raise InputError(
            f"{where}reaches {beyond:.2f} m beyond the walls: it covers x {low[0]:.2f} to {high[0]:.2f}, y "
            f"{low[1]:.2f} to {high[1]:.2f} m; move it inside the extent {list(extent)}, or widen that"
        )
    bottom = min(part.bottom_m for part in item.parts)
    if bottom < -_INTO_WALL_M:
        raise InputError(
            f"{where}reaches {-bottom:.2f} m below the floor; above = {above_m - bottom:.4g} puts it there"
        )


def check_moving_object(
    where: str,
    moving_object: MovingObject,
    extent: Extent,
    static_objects: Sequence[StaticObject],
    start: Place,
    walker: Walker,
) -> None:
    """Check that a moving object's segment is clear of walls, objects and the robot's start."""
    (ax, ay), (bx, by), radius = moving_object.start, moving_object.end, moving_object.radius_m
    line = f"the line from ({ax:g}, {ay:g}) to ({bx:g}, {by:g})"
    to_wall = min(ax - extent[0], ay - extent[1], extent[2] - ax, extent[3] - ay)
    to_wall = min(to_wall, bx - extent[0], by - extent[1], extent[2] - bx, extent[3] - by)
    if to_wall < radius - 1e-9:
        raise InputError(
            f"{where}{line} comes to {to_wall:.2f} m inside the extent {list(extent)}; its radius of "
            f"{radius:g} m must fit"
        )
    share = np.linspace(
        0.0, 1.0, 2 + int(math.dist(moving_object.start, moving_object.end) / 0.01)
    )[:, None]
    path = (1.0 - share) * np.array(moving_object.start) + share * np.array(moving_object.end)
    for name, shape in _shapes(static_objects):
        gap = float(distance(shape, path).min())
        if shape.bottom_m < moving_object.height_m and gap < radius - 1e-9:
            raise InputError(
                f"{where}{line} comes to {gap:.2f} m from {name!r}; its radius of {radius:g} m must fit, "
                f"move one of them{_CONVEX if isinstance(shape, Solid) else ''}"
            )
    gap = float(np.hypot(*(path - np.array(start)).T).min())
    needed = radius + walker.breadth * ROBOT_RADIUS_M
    if gap < needed - 1e-9:
        raise InputError(
            f"{where}{line} comes to {gap:.2f} m from the start ({start[0]:g}, {start[1]:g}); keep it "
            f"{needed:g} m away"
        )


def check_places(
    where: str,
    extent: Extent,
    static_objects: Sequence[StaticObject],
    places: Sequence[tuple[str, Place]],
    walker: Walker,
) -> None:
    """Check that the robot can stand at each named place."""
    needed = walker.breadth * ROBOT_RADIUS_M
    for what, (x, y) in places:
        if not (extent[0] < x < extent[2] and extent[1] < y < extent[3]):
            raise InputError(f"{where}{what} ({x}, {y}) lies outside the extent {list(extent)}")
        for name, shape in _shapes(static_objects):
            gap = float(distance(shape, np.array([[x, y]]))[0])
            if shape.bottom_m < walker.top_m and gap < needed - 1e-9:
                raise InputError(
                    f"{where}{what} ({x}, {y}) is {gap:.2f} m from {name!r}; the robot needs "
                    f"{needed:g} m{_CONVEX if isinstance(shape, Solid) else ''}"
                )


def check_reachable(
    where: str,
    extent: Extent,
    static_objects: Sequence[StaticObject],
    start: Place,
    goals: Sequence[Place],
    walker: Walker,
) -> None:
    """Check that a path for a robot moving sideways leads from the start to each goal.

    The check never refuses a passable scene: where a disc passes, its cells are farther from everything than its
    radius less half a cell's diagonal. It may accept gaps that are narrower by that amount.
    """
    longest = max(extent[2] - extent[0], extent[3] - extent[1])
    cell = min(max(longest / _CELLS, _FINEST_CELL_M), _COARSEST_CELL_M)
    shapes = [shape for item in static_objects if not item.wall for shape in item.parts]
    space = clearance_map(extent, shapes, cell, walker.top_m)
    reach = space.reachable(start, walker.breadth * HALF_WIDTH_M - cell / math.sqrt(2.0))
    for number, goal in enumerate(goals, 1):
        if not reach[space.cell(goal)]:
            hollow = _CONVEX if any(isinstance(shape, Solid) for shape in shapes) else ""
            raise InputError(
                f"{where}goal {number} ({goal[0]:g}, {goal[1]:g}) is not reachable from the start "
                f"({start[0]:g}, {start[1]:g}); open a gap of {2 * walker.breadth * ROBOT_RADIUS_M:g} m, or move it{hollow}"
            )


def _shapes(static_objects: Sequence[StaticObject]) -> list[tuple[str, Shape]]:
    return [(item.name, part) for item in static_objects for part in item.parts]
