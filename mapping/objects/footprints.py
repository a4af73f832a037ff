"""Footprints: the ground that obstacles cover, as outlines, from the accumulated obstacle cloud.

Points that are connected on the floor plane are one part. Parts much lower than the obstacle they touch (floor
misclassified as obstacle, a low object beside a high one) are separated as its skirt. Straight faces are found in what
is left (`faces`); those that meet at convex corners are one object. Everything else joins the object that it lies
behind, or is an object of its own. `outlines` gives the shape. Every side of it is either seen, with the deviation of
its place, or not.

Source: ours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from perception.primitives.errors import ConfigError
from perception.primitives.settings import setting

from . import faces as straight
from . import outlines
from .columns import CELL_M, Columns, Voxels, connected, stack
from .faces import BAND_M, CONVEX_M, TAKEN_M, Face
from .free_cells import FreeCells, Ring
from .pixels import inside
from .sides import EDGE_SIGMA_M, Box, box_of, sides_of

SKIRT = 0.3  # ours: columns lower than this share of the obstacle's height are its skirt
LEAST_NEIGHBOURS = 4  # ours: voxels with fewer neighbours within the gap are outliers
LEAST_STAY = 0.45
"""Ours: share of frames that see a static voxel; some miss it, so less than half. Others came or went."""
HEIGHT_SIGMA_M = 0.01  # ours: of the top of an obstacle, half a voxel
MOST_GAP_M = 5.0  # ours: all points within it are compared


@dataclass(frozen=True)
class FootprintConfig:
    """Which voxels form an obstacle."""

    gap_m: float = setting(
        0.08,
        "m",
        "wider gaps on the floor separate two obstacles",
        "ours: two pixels of a depth camera at 3 m",
    )
    least_points: int = (
        20  # ours: outliers form smaller clusters; voxels that an obstacle has at least
    )
    least_sightings: int = setting(
        2,
        "",
        "frames in which a voxel of a well-seen obstacle is seen at least",
        "ours: outliers appear once",
    )

    def __post_init__(self) -> None:
        if not CELL_M <= self.gap_m <= MOST_GAP_M:
            raise ConfigError(
                f"footprints: gap_m={self.gap_m} must be at least {CELL_M}, at most {MOST_GAP_M:g}"
            )
        if self.least_points < 3:
            raise ConfigError(f"footprints: least_points={self.least_points} must be at least 3")
        if self.least_sightings < 1:
            raise ConfigError(
                f"footprints: least_sightings={self.least_sightings} must be at least 1"
            )


@dataclass(frozen=True, eq=False)
class Footprint:
    """The footprint of one obstacle.

    Args:
        outline: Corners counter-clockwise, world frame, m; side k runs from corner k to the next one.
        seen: Whether each side was seen; one that was not only bounds what may be there.
        sigma_m: Standard deviation of the place of each side along its normal; NaN where it was not seen.
        height_m: Height of the highest point seen.
        sigma_height_m: Its standard deviation.
        probability: That an obstacle covers this ground, by the map; NaN without a map.
        several: Whether it is probably more than one thing: heights and colours change along it.
        points: Number of voxels.
        box: The rectangle, where the object is a box; else None.
    """

    outline: Ring
    seen: Bool[np.ndarray, "k"]
    sigma_m: Float[np.ndarray, "k"]
    height_m: float
    sigma_height_m: float
    probability: float
    several: bool
    points: int
    box: Box | None


def find(
    voxels: Voxels, config: FootprintConfig | None = None, free: FreeCells | None = None
) -> list[Footprint]:
    """Footprints of all obstacles on the floor, those with most points first.

    Args:
        voxels: Of obstacles; NaN places are ignored.
        config: Thresholds.
        free: Cells seen free: no footprint lies over one. None: not known.

    Returns:
        At least one footprint per obstacle; more if free cells cut it in pieces.
    """
    config = config or FootprintConfig()
    free = free or FreeCells(np.zeros((0, 0), np.bool_), np.zeros(2), 0.05)
    keep = np.isfinite(voxels.xyz).all(axis=1)
    keep[keep] = _has_neighbours(voxels.xyz[keep], config)
    voxels = voxels.of(keep)
    found: list[Footprint] = []
    for part in connected(voxels.xyz[:, :2], config.gap_m):
        sightings = voxels.sightings[part]
        if np.quantile(sightings, 0.9) >= 2 * config.least_sightings:  # a well-seen part
            part = part[sightings >= config.least_sightings]
        if len(part) >= config.least_points:
            found += _of_part(voxels.of(part), config, free)
    found.sort(key=lambda one: (-one.points, *one.outline[0].tolist()))
    return found


def voxels_of(
    xyz: Float[np.ndarray, "n 3"],
    sightings: Int[np.ndarray, "n"] | None = None,
    sensor: Float[np.ndarray, "n 2"] | None = None,
) -> Voxels:
    """Voxels of which only places, sightings and sensor positions are known, if at all."""
    n = len(xyz)
    nothing = np.full(n, np.nan)
    return Voxels(
        nothing,
        np.full((n, 2), np.nan) if sensor is None else sensor.astype(np.float64),
        np.zeros(n),
        np.zeros(n),
        np.full((n, 3), np.nan),
        nothing,
        xyz.astype(np.float64),
        np.ones(n) if sightings is None else sightings.astype(np.float64),
    )


def _has_neighbours(
    points: Float[np.ndarray, "n 3"], config: FootprintConfig
) -> Bool[np.ndarray, "n"]:
    """Whether each voxel has enough neighbours in space; single flying pixels have none."""
    if not len(points):
        return np.zeros(0, np.bool_)
    near = cKDTree(points).query_ball_point(points, config.gap_m, return_length=True)
    return np.asarray(near) - 1 >= LEAST_NEIGHBOURS


def _of_part(voxels: Voxels, config: FootprintConfig, free: FreeCells) -> list[Footprint]:
    """Footprints of one connected part."""
    columns = stack(voxels)
    faces = straight.find(columns, config.gap_m)
    found: list[Footprint] = []
    for numbers, members in _things(columns, faces, config):
        own = columns.of(members)
        if int(own.count.sum()) < config.least_points or _is_floor(own) or _has_moved(own):
            continue
        if any(inside(_grown(one.outline), own.xy).mean() > 0.5 for one in found):
            continue  # a part of the top of what stands there
        found += _footprints(own, [faces[k] for k in numbers], free)
    return found


def _things(
    columns: Columns, faces: list[Face], config: FootprintConfig
) -> list[tuple[list[int], Int[np.ndarray, "m"]]]:
    """Faces and columns of each object of a part, those with faces first.

    A column without a face joins the object whose face it lies behind, the nearest, unless it is much lower: then it
    is floor misclassified as obstacle, or a low object beside a high one.
    """
    groups = straight.group(faces)
    owner = np.full(len(columns), -1)
    for number, group in enumerate(groups):
        for k in group:
            owner[faces[k].columns] = number
    rest = np.flatnonzero(owner < 0)
    nearest, chosen_owner = np.full(len(rest), np.inf), np.full(len(rest), -1)
    for number, group in enumerate(groups):
        if not (owner == number).any():
            continue  # all its columns lie at corners, and other faces have them
        high = float(np.quantile(columns.top[owner == number], 0.95))
        places, tops = columns.xy[rest], columns.top[rest]
        behind, depth = np.ones(len(rest), np.bool_), np.full(len(rest), np.inf)
        for face in (faces[k] for k in group):
            off = face.offset_m - places @ face.normal
            along = places @ face.tangent
            beside = (along > face.span[0] - BAND_M) & (along < face.span[1] + BAND_M)
            behind &= off >= -CONVEX_M
            within = beside & ((tops >= SKIRT * high) | (np.abs(off) <= TAKEN_M))
            depth = np.where(within, np.minimum(depth, np.maximum(off, 0.0)), depth)
        closer = behind & (depth < nearest)
        nearest[closer] = depth[closer]
        chosen_owner[closer] = number
    owner[rest] = chosen_owner
    things = [(group, np.flatnonzero(owner == number)) for number, group in enumerate(groups)]
    alone = np.flatnonzero(owner < 0)
    for chosen in connected(columns.xy[alone], config.gap_m):
        piece = alone[chosen]
        trunk = columns.top[piece] >= SKIRT * np.quantile(columns.top[piece], 0.95)
        for part in (piece[trunk], piece[~trunk]):
            things += [([], part[sub]) for sub in connected(columns.xy[part], config.gap_m)]
    return things


def _is_floor(columns: Columns) -> bool:
    """Whether an object is not told from the floor by the noise of its points."""
    noise = float(np.average(columns.noise_variance, weights=columns.weight))
    return float(np.quantile(np.abs(columns.top), 0.9)) < 3.0 * math.sqrt(noise)


def _has_moved(columns: Columns) -> bool:
    """Whether an object was seen in too few of the frames that saw its place, in nine of ten columns."""
    return float(np.quantile(columns.stay, 0.9)) < LEAST_STAY  # never if it is not known


def _footprints(columns: Columns, faces: list[Face], free: FreeCells) -> list[Footprint]:
    """Footprints of one object, by the simplest shape that the map does not contradict."""
    whole, is_box = _shape(columns, faces, free)
    places = outlines.on_faces(columns, faces)
    if whole is None:
        rings = outlines.region(places, faces, free)
    else:
        rings = outlines.cut(whole, free, EDGE_SIGMA_M)
    box = box_of(whole, sides_of(whole, columns)) if whole is not None and is_box else None
    found = []
    for number, ring in enumerate(rings):
        mine = columns
        if len(rings) > 1:
            mine = columns.of(inside(_grown(ring), places))
        if len(mine):
            found.append(_footprint(ring, mine, faces, None if number else box))
    return found


def _shape(columns: Columns, faces: list[Face], free: FreeCells) -> tuple[Ring | None, bool]:
    """The convex shape of an object, None if none is believable, and whether it is a box."""
    box = outlines.rectangle(columns, faces) if faces else None
    if box is not None and not outlines.believable(box, columns, faces, free):
        box = None
    if (found := outlines.circle(columns)) is not None:
        ring, rough = found
        rounder = box is None or rough < outlines.misfit(box, columns)
        if rounder and outlines.share_free(ring, free) <= outlines.FREE_SHARE:
            return ring, False
    if box is not None:
        return box, True
    hull = outlines.hull(outlines.on_faces(columns, faces))
    known = bool(np.isfinite(columns.sensor).all())
    if hull is not None and known and outlines.share_free(hull, free) <= outlines.FREE_SHARE:
        return hull, False
    return None, False


def _grown(ring: Ring) -> Ring:
    """The outline, larger by the smear of its columns."""
    middle = ring.mean(axis=0)
    away = ring - middle
    return np.asarray(
        middle + away * (1.0 + CONVEX_M / np.maximum(np.linalg.norm(away, axis=1), 1e-3))[:, None]
    )


def _footprint(ring: Ring, columns: Columns, faces: list[Face], box: Box | None) -> Footprint:
    sides, weights = sides_of(ring, columns), columns.weight
    top = float(np.quantile(columns.top, 0.9))
    noise = float(np.average(columns.noise_variance, weights=weights))
    several = any(any(straight.differ(a, b)) for k, a in enumerate(faces) for b in faces[:k])
    return Footprint(
        ring,
        sides.seen,
        sides.sigma_m,
        top,
        math.hypot(HEIGHT_SIGMA_M, math.sqrt(noise)),
        float(np.average(columns.occupancy, weights=weights)),
        several,
        int(columns.count.sum()),
        box,
    )
