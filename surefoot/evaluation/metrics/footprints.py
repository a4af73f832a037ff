"""Footprints of static obstacles against the map, the robot's own places and the true outlines."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from mapping.objects.free_cells import FreeCells, area
from mapping.objects.pixels import inside

from .maps import FREE, GridMap

PIXEL_M = 0.01  # of the comparison of two outlines
SEEN_SHARE = 0.75  # ours: of the length of a side; with less, nobody knows where it ends
LEAST_SIDE_M = 0.10  # ours: shorter sides are no sides
MATCHED = 0.5  # intersection over union from which a footprint is that of an object


def over_free_share(footprints: Sequence[dict[str, Any]], grid: GridMap) -> float:
    """Share of the area of all footprints that lies over free cells of the saved map; 0 without footprints."""
    free = FreeCells(grid.state == FREE, grid.origin, grid.cell_m)
    rings = [_ring(one) for one in footprints]
    whole = sum(abs(area(ring)) for ring in rings)
    over = sum(abs(area(part)) for ring in rings for part in free.overlaps(ring))
    return over / whole if whole > 0.0 else 0.0


def poses_inside(footprints: Sequence[dict[str, Any]], places: Float[np.ndarray, "n 2"]) -> int:
    """How many places lie in any footprint."""
    within = np.zeros(len(places), np.bool_)
    for one in footprints:
        within |= inside(_ring(one), places)
    return int(within.sum())


def outline_metrics(
    footprints: Sequence[dict[str, Any]], truth: Sequence[dict[str, Any]]
) -> dict[str, float]:
    """Figures against the true outlines of static obstacles.

    An object counts if at least two of its sides were seen, each over three quarters of its length.

    Returns:
        footprint_objects (that count), footprint_iou_median and footprint_iou_min (of each with its best footprint,
        0 without one), footprint_sides (seen sides of matched footprints, of 10 cm and more) and
        footprint_sides_in_2sigma, the share of them that lie within two standard deviations of the true border;
        empty without objects that count.
    """
    overlaps, inlying = [], []
    for thing in truth:
        seen = [
            s for s in thing["sides"] if s["length_m"] >= LEAST_SIDE_M and s["seen"] >= SEEN_SHARE
        ]
        if len(seen) < 2 or not thing["parts_m"]:
            continue
        parts = [np.array(part) for part in thing["parts_m"]]
        found = [(_overlap(_ring(one), parts), k) for k, one in enumerate(footprints)]
        best, chosen = max(found, default=(0.0, -1))
        overlaps.append(best)
        if best >= MATCHED:
            inlying += _sides_in_band(footprints[chosen], parts)
    if not overlaps:
        return {}
    figures = {
        "footprint_objects": float(len(overlaps)),
        "footprint_iou_median": float(np.median(overlaps)),
        "footprint_iou_min": float(np.min(overlaps)),
    }
    if inlying:
        figures["footprint_sides"] = float(len(inlying))
        figures["footprint_sides_in_2sigma"] = float(np.mean(inlying))
    return figures


def _ring(footprint: dict[str, Any]) -> Float[np.ndarray, "k 2"]:
    return np.array(footprint["outline_m"], dtype=np.float64)


def _overlap(ring: Float[np.ndarray, "k 2"], parts: list[Float[np.ndarray, "m 2"]]) -> float:
    """Intersection over union of an outline and an object of several parts."""
    corners = np.concatenate([ring, *parts])
    true = np.concatenate(parts)
    if (ring.max(axis=0) < true.min(axis=0)).any() or (ring.min(axis=0) > true.max(axis=0)).any():
        return 0.0
    low, high = corners.min(axis=0), corners.max(axis=0)
    x, y = (np.arange(a, b, PIXEL_M) + PIXEL_M / 2 for a, b in zip(low, high, strict=True))
    places = np.stack(np.meshgrid(x, y), axis=-1)
    mine = inside(ring, places)
    covered = np.zeros(mine.shape, np.bool_)
    for part in parts:
        covered |= inside(part, places)
    return float((mine & covered).sum() / max(int((mine | covered).sum()), 1))


def _sides_in_band(footprint: dict[str, Any], parts: list[Float[np.ndarray, "m 2"]]) -> list[bool]:
    """For each seen side, whether its middle lies within two standard deviations of the true border."""
    ring = _ring(footprint)
    found = []
    for k, side in enumerate(footprint["sides"]):
        a, b = ring[k], ring[(k + 1) % len(ring)]
        if side["seen"] and float(np.linalg.norm(b - a)) >= LEAST_SIDE_M:
            away = min(_to_border((a + b) / 2.0, part) for part in parts)
            found.append(away <= 2.0 * side["sigma_m"])
    return found


def _to_border(place: Float[np.ndarray, "2"], ring: Float[np.ndarray, "k 2"]) -> float:
    step = np.roll(ring, -1, axis=0) - ring
    share = np.clip(((place - ring) * step).sum(axis=1) / (step**2).sum(axis=1), 0.0, 1.0)
    return float(np.linalg.norm(place - ring - share[:, None] * step, axis=1).min())
