"""What the page draws of every moment, as columns of numbers."""

from __future__ import annotations

import gzip
import math
from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from perception.primitives.camera import Camera
from perception.primitives.obstacle import MOVING, Obstacle

from ...results.moment import DRAWN, Layers, Moment, Prediction

HEIGHT_STEP_M = 0.01  # ours: finer than the map of a walk; 0 also where no height was measured
OFTEN = 0.5  # ours: a camera with fewer pictures than this share of the moments would make its view flicker


def columns(moments: Sequence[Moment]) -> dict[str, Any]:
    """The columns of the page, one entry a moment; positions in m, angles in rad."""
    return {
        "moving": MOVING,
        "t": [_r(moment.stamp_s - moments[0].stamp_s, 3) for moment in moments],
        "pose": [_pose(moment) for moment in moments],
        "cameras": _cameras(moments),
        "head": [_row(moment.head) for moment in moments],
        "feet": [None if one.feet is None else _rows(one.feet) for one in moments],
        "heights": _heights(moments),
        "surfaces": _surfaces(moments),
        "steps": [_rows(moment.steps) for moment in moments],
        "route": [_rows(moment.route) for moment in moments],
        "gaze": [_row(moment.gaze) for moment in moments],
        "why": [moment.why for moment in moments],
        "tracks": [_tracks(moment) for moment in moments],
    }


def _heights(moments: Sequence[Moment]) -> list[Any] | None:
    """Height of body and soles at every moment; None on one floor."""
    if all(moment.heights_m is None for moment in moments):
        return None
    return [_row(moment.heights_m) for moment in moments]


def _surfaces(moments: Sequence[Moment]) -> dict[str, Any] | None:
    """The surfaces of the ground, each time they are new, and the lowest and the highest; None on one floor."""
    numbers, found, last = [], [], None
    for number, moment in enumerate(moments):
        if moment.surfaces is None or moment.surfaces is last:
            continue
        last = moment.surfaces
        numbers.append(number)
        found.append([[_rows(one.corners), one.borders.tolist()] for one in last])
    heights = [corner[2] for each in found for ring, _ in each for corner in ring]
    if not heights:
        return None
    return {"moments": numbers, "of": found, "low": min(heights), "high": max(heights)}


def gaze_maps(moments: Sequence[Moment]) -> tuple[dict[str, Any] | None, bytes]:
    """The gaze maps, one for each new one, as [tilt, pan]; None where the planner has none."""
    found: list[int] = []
    data: list[bytes] = []
    first = last = None
    for number, moment in enumerate(moments):
        one = moment.gaze_map
        if one is None or one is last:
            continue
        first = first or one
        last = one
        if one.values.shape == first.values.shape:
            found.append(number)
            data.append(np.rint(255.0 * one.values.T).astype(np.uint8).tobytes())
    if first is None:
        return None, b""
    head = {
        "moments": found,
        "rows": len(first.tilts),
        "columns": len(first.pans),
        "pans": _row(first.pans),
        "tilts": _row(first.tilts),
    }
    return head, packed(b"".join(data))


def grids(found: Sequence[tuple[int, Layers]]) -> tuple[dict[str, Any] | None, bytes]:
    """Probability, confidence and height of every grid, a byte a cell, one after the other; and where each lies."""
    if not found:
        return None, b""
    places, data, offset = [], [], 0
    for _, grid in found:
        rows, across = grid.probability.shape
        places.append([offset, rows, across, *_row(grid.origin)])
        heights = np.nan_to_num(np.rint(grid.height_m / HEIGHT_STEP_M), nan=0.0).clip(0, 255)
        for layer in (grid.probability, grid.confidence, heights.astype(np.uint8)):
            data.append(np.ascontiguousarray(layer).tobytes())
        offset += 3 * rows * across
    head = {
        "cell_m": float(found[0][1].cell_m),
        "height_step_m": HEIGHT_STEP_M,
        "moments": [number for number, _ in found],
        "places": places,
    }
    return head, packed(b"".join(data))


def packed(data: bytes) -> bytes:
    """Compressed; the same data give the same bytes."""
    return gzip.compress(data, 9, mtime=0)


def _pose(moment: Moment) -> list[float | None] | None:
    """x, y, yaw, and the covariance xx, xy, yy and of yaw."""
    if moment.pose is None:
        return None
    P = moment.pose.covariance
    spread = [_r(P[i, j], 9) for i, j in ((0, 0), (0, 1), (1, 1), (2, 2))]
    return [*_row(moment.pose.mean), *spread]


def _cameras(moments: Sequence[Moment]) -> list[dict[str, Any]]:
    """Place and view of the cameras with pictures at most moments, else of the one with the most."""
    count = Counter(name for moment in moments for name in moment.cameras)
    often = [name for name, number in count.most_common() if number >= OFTEN * len(moments)]
    shown = []
    for name in often or [name for name, _ in count.most_common(1)]:
        lens = next((one.lenses[name] for one in moments if name in one.lenses), None)
        if lens is None:
            continue
        poses = [moment.cameras.get(name) for moment in moments]
        rows = [None if T is None else _row((*T.translation, *T.quat_xyzw)) for T in poses]
        shown.append({"name": name, "slopes": _slopes(lens), "pose": rows})
    return shown


def _slopes(lens: Camera) -> list[float | None]:
    """Slopes x/z of the left and right border of a picture, y/z of its upper and lower one."""
    x, y = (np.broadcast_to(one, (lens.height, lens.width)) for one in lens.slopes)
    row, column = lens.height // 2, lens.width // 2
    return [_r(v, 4) for v in (x[row, 0], x[row, -1], y[0, column], y[-1, column])]


def _tracks(moment: Moment) -> list[dict[str, Any]]:
    predictions = moment.predictions or ((),) * len(moment.tracks)
    return [_track(one, ahead) for one, ahead in zip(moment.tracks, predictions, strict=False)]


def _track(one: Obstacle, predictions: tuple[Prediction, ...]) -> dict[str, Any]:
    return {
        "id": one.track,
        "at": _row(one.position),
        "velocity": _row(one.velocity),
        "covariance": _spread(one.state.covariance),
        "radius": _r(one.radius_m, 3),
        "height": _r(one.height_m, 3),
        "moving": _r(one.moving, 3),
        "predicted": [
            [_r(ahead.seconds, 2), _r(ahead.weight, 3), _row(ahead.mean, 3), _spread(ahead.covariance)]
            for ahead in predictions
            if ahead.weight >= DRAWN
        ],
    }  # fmt: skip


def _spread(P: Any) -> list[float | None]:
    return [_r(P[0, 0], 7), _r(P[0, 1], 7), _r(P[1, 1], 7)]


def _r(value: Any, digits: int) -> float | None:
    """Rounded; None where it is not finite, as JSON has it."""
    return round(float(value), digits) if math.isfinite(value) else None


def _row(values: Any, digits: int = 4) -> Any:
    return None if values is None else [_r(value, digits) for value in values]


def _rows(values: Any) -> list[list[float | None]]:
    return [_row(value, 3) for value in values]
