"""What lies around a run as a whole: its maps from above, its cloud, obstacles, landmarks and goals."""

from __future__ import annotations

import base64
import math
from collections.abc import Iterator, Sequence
from typing import Any

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from mapping.io import clouds, geotiff, nav2, world_file
from mapping.surface.traversability import load_layers
from perception.primitives.errors import SurefootError

from ...config.load import load
from ...results.moment import Moment
from ...results.run_folder import MAP, PANORAMA, RunFolder
from ..plots.surface import BACKGROUND, splat
from .columns import packed

CLOUD_POINTS = 60_000  # ours: 0.4 MB of the page
FINEST_M = 0.02  # ours: first side of the voxels of the cloud
LAYER_PX = 1500  # ours: a larger map is drawn at less detail
GREY_FREE, GREY_OCCUPIED = 250, 90
DARKEST = 0.3  # ours: of the colours, for a low point on a dark background
CEILING_M = 2.2  # ours: what hangs higher would hide the room from above


def surroundings(run: RunFolder, moments: Sequence[Moment]) -> tuple[dict[str, Any], bytes]:
    """Entries of the page about the whole run, and its packed cloud (empty without one)."""
    summary = run.read_json("summary.json") or {}
    points, colours = _points(run)
    layers = list(_layers(run, points, colours))
    areas = _areas(run)
    goals = [list(goal[:2]) for goal in summary.get("goal_positions") or []]
    if not goals:
        goals = [list(goal) for goal in dict.fromkeys(_goal(one) for one in moments) if goal]
    footprints = (run.read_json("obstacles.json") or {}).get("footprints") or []
    landmarks = [list(mark[1:3]) for mark in summary.get("landmarks") or []]
    cloud, data = _cloud(points, colours)
    stamps = np.array([one.stamp_s for one in moments])
    entries = {
        "layers": layers,
        "cloud": cloud,
        "areas": areas,
        "goals": goals,
        "landmarks": landmarks,
        "footprints": [one["outline_m"] for one in footprints if "outline_m" in one],
        "body": body_of(run, moments),
        "begins": [int(np.argmax(mine)) for mine in run.sessions(stamps).values()],
        "box": _box(layers, moments, [*goals, *([] if layers else landmarks)], areas),
    }
    return entries, data


def _goal(moment: Moment) -> tuple[float, float] | None:
    return None if moment.goal is None else (float(moment.goal[0]), float(moment.goal[1]))


def body_of(run: RunFolder, moments: Sequence[Moment]) -> dict[str, Any] | None:
    """Sizes of the walking body, m; None for what has no head on joints: a camera in a hand, a robot on wheels."""
    if all(one.head is None for one in moments):
        return None
    try:
        model = load(run.path("config.toml") if run.has("config.toml") else None).robot_model
    except SurefootError:  # of another version
        return None
    trunk = [model.depth_m, model.width_m, model.height_m]
    return {"radius": model.radius_m, "foot": list(model.foot_m), "trunk": trunk}


def _points(
    run: RunFolder,
) -> tuple[Float[np.ndarray, "n 3"], UInt8[np.ndarray, "n 3"]]:
    """The cloud of the run with its colours, or those of its heights; empty without one."""
    name = next((one for one in ("cloud.ply", "panorama.ply") if run.has(one)), None)
    if name is None:
        return np.zeros((0, 3)), np.zeros((0, 3), np.uint8)
    points, colours = clouds.load_ply(run.path(name))
    if not len(points):
        return points, np.zeros((0, 3), np.uint8)
    if colours is None:
        low, high = np.percentile(points[:, 2], (2, 98))
        colours = _painted(DARKEST + (points[:, 2] - low) / max(float(high - low), 1e-3))
    return points, colours


def _thinned(
    points: Float[np.ndarray, "n 3"], colours: UInt8[np.ndarray, "n 3"]
) -> tuple[Float[np.ndarray, "m 3"], UInt8[np.ndarray, "m 3"]]:
    """At most `CLOUD_POINTS` points, evenly."""
    side = FINEST_M
    while True:  # one point a voxel, in coarser ones until they are few enough
        cells = np.floor((points - points.min(axis=0)) / side).astype(np.int64)
        sizes = cells.max(axis=0) + 1
        keys = (cells[:, 0] * sizes[1] + cells[:, 1]) * sizes[2] + cells[:, 2]
        chosen = np.unique(keys, return_index=True)[1]
        if len(chosen) <= CLOUD_POINTS:
            return points[chosen], colours[chosen]
        side *= 1.25


def _cloud(
    points: Float[np.ndarray, "n 3"], colours: UInt8[np.ndarray, "n 3"]
) -> tuple[dict[str, Any] | None, bytes]:
    """Coordinates as multiples of a step in 16 bits, then colours."""
    if not len(points):
        return None, b""
    points, colours = _thinned(points, colours)
    low = points.min(axis=0)
    step = max(float((points.max(axis=0) - low).max()) / 65535, 1e-6)
    steps = np.rint((points - low) / step).astype("<u2")
    head = {"count": len(points), "low": [float(v) for v in low], "step": step}
    return head, packed(steps.tobytes() + colours.tobytes())


def _layers(
    run: RunFolder, points: Float[np.ndarray, "n 3"], colours: UInt8[np.ndarray, "n 3"]
) -> Iterator[dict[str, Any]]:
    """The maps of the whole run as pictures: the first is shown first."""
    if run.kind in (MAP, PANORAMA) and len(points):
        low = points[:, 2] < CEILING_M
        picture, (left, right, bottom, _) = splat(points[low], colours[low])
        seen = (picture != BACKGROUND).any(axis=-1)
        cell_m = (right - left) / seen.shape[1]
        yield _layer("surface", picture, seen, np.array([left, bottom]), cell_m)
    if run.has("map.yaml"):
        grid = nav2.load(run.path("map.yaml"))
        level = GREY_FREE + grid.probability * (GREY_OCCUPIED - GREY_FREE)
        grey = np.repeat(np.clip(level, 0, 255).astype(np.uint8)[..., None], 3, axis=2)
        yield _layer("occupancy", grey, grid.known, grid.origin, grid.cell_m)
    if run.has("layers.npz"):
        saved = load_layers(run.path("layers.npz"))
        origin, cell_m = saved["origin"], float(saved["resolution"])
        for name, key in (("floor height", "elevation"), ("traversable", "traversability")):
            yield from _scaled(name, saved[key], origin, cell_m)
    elif run.has(world_file.LAYERS):
        bands, origin, cell_m = geotiff.load(run.path(world_file.LAYERS))
        yield from _scaled("height", bands["height_m"], origin, cell_m)


def _scaled(
    name: str, layer: Float[np.ndarray, "rows columns"], origin: Any, cell_m: float
) -> Iterator[dict[str, Any]]:
    """A layer in the colours of its middle 98 %."""
    seen = np.isfinite(layer)
    if not seen.any():
        return
    low, high = np.nanpercentile(layer, (1, 99))
    level = (np.nan_to_num(layer) - low) / max(float(high - low), 1e-3)
    yield _layer(name, _painted(level), seen, np.asarray(origin, np.float64), cell_m)


def _painted(level: Float[np.ndarray, "*n"]) -> UInt8[np.ndarray, "*n 3"]:
    """Cividis, which is safe for the colour-blind; level in [0, 1]."""
    from matplotlib import colormaps

    return np.asarray(colormaps["cividis"](np.clip(level, 0.0, 1.0), bytes=True)[..., :3], np.uint8)


def _layer(
    name: str,
    rgb: UInt8[np.ndarray, "rows columns 3"],
    seen: Bool[np.ndarray, "rows columns"],
    origin: Float[np.ndarray, "2"],
    cell_m: float,
) -> dict[str, Any]:
    """The seen part of a map as a PNG, transparent elsewhere; row 0 of the arrays at the smallest y."""
    rows, columns = (np.flatnonzero(seen.any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        rows = columns = np.array([0])
    top, left = int(rows[0]), int(columns[0])
    part = (slice(top, int(rows[-1]) + 1), slice(left, int(columns[-1]) + 1))
    picture = np.dstack([rgb[part][..., ::-1], np.where(seen[part], 255, 0).astype(np.uint8)])
    every = math.ceil(max(picture.shape[:2]) / LAYER_PX)
    picture = np.ascontiguousarray(picture[::every, ::every][::-1])
    done, data = cv2.imencode(".png", picture)
    assert done, "a picture of bytes can be encoded"
    return {
        "name": name,
        "png": "data:image/png;base64," + base64.b64encode(data.tobytes()).decode("ascii"),
        "origin": [float(origin[0] + left * cell_m), float(origin[1] + top * cell_m)],
        "cell_m": cell_m * every,
        "size": [picture.shape[1], picture.shape[0]],
    }


def _areas(run: RunFolder) -> list[dict[str, Any]]:
    """Obstacles of a panorama between their edges, and the directions of its gaps; base frame, m."""
    content = run.read_json("panorama.json")
    if content is None:
        return []
    areas = []
    for one in content["gaps"]:
        reach = one["distance_m"] or 1.0
        turns = np.linspace(one["right_rad"], one["left_rad"], 24)
        ring = [[0.0, 0.0], *(np.column_stack([np.cos(turns), np.sin(turns)]) * reach).tolist()]
        areas.append({"ring": ring, "name": ""})
    for number, one in enumerate(content["obstacles"], 1):
        edges = [one["left_edge_m"], one["right_edge_m"]]
        if all(value is not None for edge in edges for value in edge):
            areas.append({"ring": edges, "name": str(number)})
    return areas


def _box(
    layers: Sequence[dict[str, Any]],
    moments: Sequence[Moment],
    marks: Sequence[Sequence[float]],
    areas: Sequence[dict[str, Any]],
) -> list[float]:
    """left, bottom, right, top of what the top view shows, m."""
    places = [[0.0, 0.0]] if areas else []
    places += [[float(v) for v in one.pose.mean[:2]] for one in moments if one.pose is not None]
    places += [list(T.translation[:2]) for one in moments for T in one.cameras.values()]
    places += [list(mark) for mark in marks]
    places += [corner for area in areas for corner in area["ring"]]
    seen = {id(one.surfaces): one.surfaces for one in moments if one.surfaces is not None}
    places += [c[:2].tolist() for each in seen.values() for one in each for c in one.corners]
    for layer in layers[:1]:
        (x, y), (wide, high), cell = layer["origin"], layer["size"], layer["cell_m"]
        places += [[x, y], [x + wide * cell, y + high * cell]]
    if not places:
        return [-1.0, -1.0, 1.0, 1.0]
    low, high = np.min(places, axis=0), np.max(places, axis=0)
    spare = np.maximum(0.2, (1.5 - (high - low)) / 2)
    return [float(v) for v in (*(low - spare), *(high + spare))]
