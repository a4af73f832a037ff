"""Steps of the panorama against OpenCV: labelling level sets, locating views; and the time to render views.

All labellings include bounding box and size of every part, which the obstacles need. The hardest peers: OpenCV on the
bounding box of each level, cc3d, which labels all levels at once, and OpenCV's correlation on the same window.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float32, UInt8
from scipy import ndimage

from mapping.panorama import level_sets
from mapping.panorama.adjustment import Placed
from mapping.panorama.key_angles import locate, prepared
from mapping.panorama.rendering import render
from mapping.panorama.sphere import Sphere
from mapping.panorama.views import View
from perception.primitives.camera import Camera
from perception.primitives.frame import Depth
from perception.primitives.pose import Pose3, head_rotation

from .benchmark import Benchmark, Comparison, race

PX_PER_DEG = 4.0
DIRECTIONS_DEG = [(yaw, 0) for yaw in (-60, -30, 0, 30, 60)] + [
    (yaw, pitch) for pitch in (-17, 17) for yaw in (-30, 30)
]
REACH_PX = (3, 3)  # 0.75 deg: three standard deviations of the registration error


def room(sphere: Sphere, rng: np.random.Generator) -> Float32[np.ndarray, "h w"]:
    """Range image of a room with boxes, with noise, from 0.5 m above its floor."""
    rays = sphere.rays
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = np.where(rays[..., 2] < 0.0, -0.5 / rays[..., 2], 9.0)
        distance = np.minimum(distance, 2.4 / np.maximum(rays[..., 0], 1e-6))
        for side in (-1.0, 1.0):
            distance = np.minimum(distance, 1.5 / np.maximum(side * rays[..., 1], 1e-6))
    for _ in range(12):
        x, y = int(rng.integers(sphere.width)), int(rng.integers(sphere.height))
        w, h = (int(s) for s in rng.integers(15, 70, 2))
        box = distance[y : y + h, x : x + w]
        np.minimum(box, rng.uniform(0.7, 2.0), out=box)
    return (distance + rng.normal(0.0, 0.004, distance.shape)).astype(np.float32)


def run() -> Comparison:
    """A panorama of nine views of 176x144 px at 4 px/deg."""
    rng = np.random.default_rng(0)
    reach = (math.radians(82.0), math.radians(34.5))
    sphere = Sphere.window(-reach[0], reach[0], -reach[1], reach[1], math.degrees(PX_PER_DEG))
    range_m = room(sphere, rng)
    slices = level_sets.levels(level_sets.forward_distance(range_m, sphere))

    labelling: dict[str, Callable[[], int]] = {
        "ccl": lambda: len(level_sets.label(slices)),
        "ccl_cv2": lambda: _per_level(slices),
        "ccl_cropped": lambda: _cropped(slices),
    }
    cc3d: Any = None
    with suppress(ImportError):
        cc3d = importlib.import_module("cc3d")
        labelling["ccl_cc3d"] = lambda: _all_levels(cc3d, slices)
    parts = {name: float(label()) for name, label in labelling.items()}
    times = race(labelling, rounds=9)
    matching, errors = _locating(range_m, rng)
    times.update(matching)
    times.update(race({"warps": _warps(rng)}, rounds=5))
    ratios = {
        f"ratio_{name}": times[peer] / times[peer.partition("_")[0]]
        for name, peer in (
            ("ccl", "ccl_cv2"),
            ("ccl_cropped", "ccl_cropped"),
            ("ccl_cc3d", "ccl_cc3d"),
            ("fncc", "fncc_cv2"),
            ("fncc_window", "fncc_window"),
        )
        if peer in times
    }
    names = {
        "ratio_ccl_cropped": "OpenCV labelling within the box of each level",
        "ratio_ccl_cc3d": "cc3d on all levels at once",
        "ratio_fncc_window": "OpenCV correlation on the same window",
    }
    return Comparison(
        {f"{name}_ms": ms for name, ms in times.items()},
        ratios,
        {
            "parts": parts["ccl"],
            "parts_that_differ": max(parts.values()) - min(parts.values()),
            **errors,
        },
        {said: ratios[name] for name, said in names.items() if name in ratios},
        [] if cc3d else ["connected-components-3d"],
    )


def _per_level(slices: UInt8[np.ndarray, "h w"]) -> int:
    """Parts of all levels, one level after the other."""
    found = 0
    for level in range(1, 51):
        mask = (slices == level).astype(np.uint8)
        found += cv2.connectedComponentsWithStats(mask, connectivity=8)[0] - 1
    return found


def _cropped(slices: UInt8[np.ndarray, "h w"]) -> int:
    """The same, each level within its bounding box, all boxes found in one pass."""
    found = 0
    for level, box in enumerate(ndimage.find_objects(slices, 50), start=1):
        if box is not None:
            mask = np.equal(slices[box], level).view(np.uint8)
            found += cv2.connectedComponentsWithStats(mask, connectivity=8)[0] - 1
    return found


def _all_levels(cc3d: Any, slices: UInt8[np.ndarray, "h w"]) -> int:
    """The same by cc3d, which joins pixels of equal value."""
    labels, count = cc3d.connected_components(slices, connectivity=8, return_N=True)
    cc3d.statistics(labels, no_slice_conversion=True)
    return int(count)


def _locating(
    range_m: Float32[np.ndarray, "h w"], rng: np.random.Generator
) -> tuple[dict[str, float], dict[str, float]]:
    """Nine image patches with new noise, up to 2 px from their expected position."""
    cuts = []
    for yaw, pitch in DIRECTIONS_DEG:
        x = round((yaw + 82 - 22) * PX_PER_DEG) + int(rng.integers(-2, 3))
        y = round((34.5 - pitch - 17.5) * PX_PER_DEG) + int(rng.integers(-2, 3))
        x, y = max(0, min(x, range_m.shape[1] - 176)), max(0, min(y, range_m.shape[0] - 140))
        cut = range_m[y : y + 140, x : x + 176]
        noisy = cut + rng.normal(0.0, 0.004, cut.shape).astype(np.float32)
        expected = (x + int(rng.integers(-2, 3)), y + int(rng.integers(-2, 3)))
        cuts.append((noisy, (x, y), expected))

    def ours() -> list[tuple[float, float]]:
        panorama = prepared(range_m)
        places = []
        for cut, _, expected in cuts:
            found = locate(panorama, prepared(cut), expected, REACH_PX)
            assert found is not None, "the panorama has no gaps"
            places.append((found.x, found.y))
        return places

    def theirs() -> list[tuple[float, float]]:
        places = []
        for cut, _, _ in cuts:
            likeness = cv2.matchTemplate(range_m, cut, cv2.TM_CCOEFF_NORMED)
            x, y = cv2.minMaxLoc(likeness)[3]
            places.append((float(x), float(y)))
        return places

    def in_window() -> list[tuple[float, float]]:
        places = []
        for cut, _, (x, y) in cuts:
            left, top = max(x - REACH_PX[0], 0), max(y - REACH_PX[1], 0)
            height, width = cut.shape
            window = range_m[top : y + REACH_PX[1] + height, left : x + REACH_PX[0] + width]
            likeness = cv2.matchTemplate(window, cut, cv2.TM_CCOEFF_NORMED)
            across, down = cv2.minMaxLoc(likeness)[3]
            places.append((float(left + across), float(top + down)))
        return places

    true = np.array([place for _, place, _ in cuts], dtype=float)
    candidates = {"fncc": ours, "fncc_cv2": theirs, "fncc_window": in_window}
    errors = {
        f"{name}_error_px": float(np.max(np.abs(np.rint(locate_all()) - true)))
        for name, locate_all in candidates.items()
    }
    return race(candidates, rounds=9), errors


def _warps(rng: np.random.Generator) -> Callable[[], object]:
    """Render nine views of flat walls onto the sphere."""
    camera = Camera.from_view(176, 144, math.radians(44.0), math.radians(35.0))
    views, placed = [], []
    for yaw, pitch in DIRECTIONS_DEG:
        z = (1.5 + rng.normal(0.0, 0.004, (144, 176))).astype(np.float32)
        pose = Pose3.from_rotation(
            head_rotation(-math.radians(yaw), -math.radians(pitch)), np.zeros(3)
        )
        views.append(View(Depth(z, np.full_like(z, 0.004), camera), ()))
        placed.append(Placed(pose, np.eye(6) * 1e-6, "encoders", 0))
    return lambda: render(views, placed)


BENCHMARK = Benchmark(
    "panorama",
    "Labelling 50 level sets, locating nine views, against OpenCV",
    run,
    {"ratio_ccl": 25.0, "ratio_fncc": 4.0},
    {"parts_that_differ": 0.0, "fncc_error_px": 0.0},
)
