"""The figures of every moment: values in words, and the time series."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from perception.primitives.obstacle import MOVING

from ...results.moment import UNKNOWN, Layers, Moment

OCCUPIED = 0.5  # ours: a cell that is more probably occupied than free is an obstacle

Numbers = list[float | None]


def figures(
    moments: Sequence[Moment], grids: Sequence[tuple[int, Layers]]
) -> tuple[list[tuple[str, list[str]]], list[dict[str, Any]]]:
    """Values as (name, words of each moment), and series as the page plots them.

    What a run never knows is left out.
    """
    nearest = nearest_obstacle(moments, grids)
    return _values(moments, nearest), _series(moments, nearest)


def nearest_obstacle(moments: Sequence[Moment], grids: Sequence[tuple[int, Layers]]) -> Numbers:
    """Distance from the body's centre to the nearest occupied cell or the rim of a track, m."""
    found: Numbers = []
    starts = [number for number, _ in grids]
    cells: dict[int, Float[np.ndarray, "n 2"]] = {}
    for number, moment in enumerate(moments):
        if moment.pose is None:
            found.append(None)
            continue
        at = moment.pose.mean[:2]
        gaps = [math.dist(at, one.position) - one.radius_m for one in moment.tracks]
        k = int(np.searchsorted(starts, number, side="right")) - 1
        if k >= 0:
            if k not in cells:
                cells = {k: _occupied(grids[k][1])}
            if len(cells[k]):
                gaps.append(float(np.hypot(*(cells[k] - at).T).min()))
        found.append(max(min(gaps), 0.0) if gaps else None)
    return found


def _occupied(grid: Layers) -> Float[np.ndarray, "n 2"]:
    """Centres of the occupied cells, m."""
    known = grid.probability != UNKNOWN
    rows, columns = np.nonzero(known & (grid.probability > 254 * OCCUPIED))
    return np.column_stack([columns, rows]) * grid.cell_m + grid.origin + grid.cell_m / 2


def _values(moments: Sequence[Moment], nearest: Numbers) -> list[tuple[str, list[str]]]:
    def each(words: Callable[[Moment], str]) -> list[str]:
        return [words(moment) for moment in moments]

    rows = [
        ("decision", each(lambda one: one.why)),
        ("status", each(lambda one: "; ".join(one.status))),
        ("claimed risk", each(lambda one: _said(one.risk, "{:.1%} chance of contact"))),
        ("position", each(_position)),
        ("heading", each(_heading)),
        ("height", each(_height)),
        ("nearest obstacle", [_said(gap, "{:.2f} m") for gap in nearest]),
        ("head", each(lambda one: _angles(one.head))),
        ("tracks", each(_tracks) if any(one.tracks for one in moments) else []),
        ("gaze wanted", each(lambda one: _angles(one.gaze))),
        ("time per frame", each(lambda one: _said(_total(one), "{:.0f} ms"))),
    ]
    for name in dict.fromkeys(name for moment in moments for name in moment.floor):
        rows.append((f"floor ({name})", [_floor(moment, name) for moment in moments]))
    return [(name, words) for name, words in rows if any(words)]


def _position(moment: Moment) -> str:
    if moment.pose is None:
        return ""
    x, y, _ = moment.pose.mean
    P = moment.pose.covariance[:2, :2]
    sigma = (
        math.sqrt(max(float(np.linalg.eigvalsh(P)[-1]), 0.0)) if np.isfinite(P).all() else math.inf
    )
    return f"{x:z.2f}, {y:z.2f} m" + (f" ± {100 * sigma:.1f} cm" if math.isfinite(sigma) else "")


def _heading(moment: Moment) -> str:
    if moment.pose is None:
        return ""
    sigma = math.degrees(math.sqrt(max(float(moment.pose.covariance[2, 2]), 0.0)))
    said = f"{math.degrees(moment.pose.mean[2]):z.0f}°"
    return said + (f" ± {sigma:.1f}°" if math.isfinite(sigma) else "")


def _height(moment: Moment) -> str:
    if moment.heights_m is None or moment.height_sigma_m is None:
        return ""
    return (
        f"{100 * moment.heights_m[0]:z.1f} ± {100 * moment.height_sigma_m:.1f} cm above the start"
    )


def _angles(pair: tuple[float, float] | None) -> str:
    if pair is None:
        return ""
    pan, tilt = (math.degrees(angle) for angle in pair)
    side = "left" if pan >= 0 else "right"
    return f"{abs(pan):.0f}° {side}, {abs(tilt):.0f}° {'down' if tilt >= 0 else 'up'}"


def _tracks(moment: Moment) -> str:
    moving = sum(one.moving >= MOVING for one in moment.tracks)
    return f"{len(moment.tracks)}, {moving} moving"


def _floor(moment: Moment, camera: str) -> str:
    seen = moment.floor.get(camera)
    if seen is None:
        return ""
    height = f"{seen.height_m:.3f} m ± {1e3 * math.sqrt(max(float(seen.covariance[2, 2]), 0.0)):.1f} mm below"
    return f"{height}, {seen.share:.0%} of the points" if seen.share else f"{height}, expected"


def _said(value: float | None, shown: str) -> str:
    return "" if value is None else shown.format(value)


def _total(moment: Moment) -> float | None:
    times = moment.timing_ms
    if not times:
        return None
    return float(times.get("total", sum(times.values())))


def _series(moments: Sequence[Moment], nearest: Numbers) -> list[dict[str, Any]]:
    def deviations(axis: int, scale: float) -> Numbers:
        return [
            None
            if one.pose is None
            else scale * math.sqrt(max(float(one.pose.covariance[axis, axis]), 0.0))
            for one in moments
        ]

    def degrees(pairs: Sequence[tuple[float, float] | None], which: int) -> Numbers:
        return [None if pair is None else math.degrees(pair[which]) for pair in pairs]

    heads = [one.head or one.gaze for one in moments]
    tracked = any(one.tracks for one in moments)
    moving: Numbers = [float(sum(o.moving >= MOVING for o in one.tracks)) for one in moments]
    every: Numbers = [float(len(one.tracks)) for one in moments]
    heights: Numbers = [
        None if one.heights_m is None else 100.0 * float(one.heights_m[0]) for one in moments
    ]
    found = [
        _plot("Standard deviation of the position", "cm", x=deviations(0, 100.0), y=deviations(1, 100.0)),
        _plot("Standard deviation of the heading", "deg", heading=deviations(2, math.degrees(1.0))),
        _plot("Height above the start", "cm", zero=False, body=heights),
        _plot("Nearest obstacle, from the body's centre", "m", distance=nearest),
        _plot("Claimed risk of the chosen plan", "probability", risk=[one.risk for one in moments]),
        _plot("Direction of the head", "deg", zero=False, pan=degrees(heads, 0), tilt=degrees(heads, 1)),
        _plot("Tracks", "number", all=every if tracked else [], moving=moving if tracked else []),
        _plot("Time per frame", "ms", cut=True, time=[_total(one) for one in moments]),
    ]  # fmt: skip
    for name in dict.fromkeys(name for one in moments for name in one.floor):
        seen = [one.floor.get(name) for one in moments]
        shares: Numbers = [None if one is None else 100.0 * one.share for one in seen]
        found.append(_plot(f"Points on the floor ({name})", "%", share=shares))
    return [one for one in found if one["lines"]]


def _plot(
    name: str, unit: str, zero: bool = True, cut: bool = False, **lines: Numbers
) -> dict[str, Any]:
    """A plot of the lines with any number; `zero`: its axis begins at zero; `cut`: it ends where few values are."""
    drawn = [
        {"name": line, "values": [_rounded(value) for value in values]}
        for line, values in lines.items()
        if any(value is not None and math.isfinite(value) for value in values)
    ]
    return {"name": name, "unit": unit, "zero": zero, "cut": cut, "lines": drawn}


def _rounded(value: float | None) -> float | None:
    return float(f"{value:.4g}") if value is not None and math.isfinite(value) else None
