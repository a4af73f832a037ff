"""Placement of tags on walls and tall furniture, so that several are visible from everywhere.

Positions are chosen greedily: of all free spots on vertical faces the one visible, within range and at a moderate
viewing angle, from the most places that still see few tags. Source: ours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from perception.primitives.landmark import Landmark
from perception.primitives.pose import Pose2

from ..free_space import clearance_map
from ..rendering.textures import TAG_MARGIN_MODULES, TAG_MODULES
from ..scene import Extent, Place, StaticObject
from ..shapes import Box, Shape, distance, outline

SIDE_M = 0.22  # ours: black square; 24 px at 3.3 m in the colour camera, 4 px per module
PLATE_M = SIDE_M * (TAG_MODULES + 2 * TAG_MARGIN_MODULES) / TAG_MODULES
AHEAD_M, WIDE_M = 0.10, 0.6 * PLATE_M
"""Ours: free space before a plate and to each side of its middle."""
SPACE_M = math.hypot(AHEAD_M, WIDE_M) + 1e-6  # nothing farther from the middle lies in it
THICKNESS_M = 0.006
IN_VIEW_M = 2.5  # ours: range within which a tag counts as visible
OCCLUDING_M = 0.33  # ours: taller shapes occlude a tag at 0.45 m for a camera at 0.4 m
ENOUGH = 3  # ours: visible tags after which more count little
OBLIQUE_DEG = 60.0  # ours: greatest viewing angle


@dataclass(frozen=True)
class _Spot:
    centre: tuple[float, float, float]
    normal_rad: float


def place_tags(
    extent: Extent,
    static_objects: tuple[StaticObject, ...],
    start: Pose2,
    count: int,
    others: tuple[Place, ...] = (),
    first: int = 0,
    cell_m: float = 0.25,
) -> tuple[tuple[StaticObject, ...], tuple[Landmark, ...]]:
    """Tag plates and the corresponding landmarks.

    Args:
        extent: Of the floor, m.
        static_objects: Walls and furniture; tags are placed on faces of boxes that are wide and high enough.
        start: Start of the robot; only places reachable from it count.
        count: Greatest number of tags (the dictionary has `textures.MOST_TAGS`).
        others: Further reachable places, behind doorways narrower than the grid of 25 cm resolves.
        first: Number of the first tag.
        cell_m: Grid of the places from which tags are to be seen.
    """
    shapes = [part for item in static_objects for part in item.parts]
    space = clearance_map(
        extent, [s for t in static_objects if not t.wall for s in t.parts], cell_m
    )
    inside = [s for t in static_objects if t.wall for s in t.parts if _inside(s, extent)]
    space_all = clearance_map(
        extent, [s for t in static_objects if not t.wall for s in t.parts] + inside, cell_m
    )
    reachable = space_all.reachable((start.x, start.y), 0.15).ravel()
    for place in others:
        reachable |= space_all.reachable(place, 0.15).ravel()
    places = space.centres[reachable]
    spots = _spots(extent, shapes)
    seen = _visible(places, spots, shapes)
    chosen: list[int] = []
    views = np.zeros(len(places))
    open_spots = np.ones(len(spots), bool)
    centres = np.array([spot.centre for spot in spots])
    while len(chosen) < count and open_spots.any():
        worth = 0.35 ** np.minimum(views, ENOUGH + 1)
        gain = np.where(open_spots, worth @ seen, -1.0)
        best = int(np.argmax(gain))
        if gain[best] <= 0.0:
            break
        chosen.append(best)
        views += seen[:, best]
        open_spots &= np.linalg.norm(centres - centres[best], axis=1) > 1.3 * PLATE_M
    plates, landmarks = [], []
    for identity, index in enumerate(chosen, first):
        spot = spots[index]
        ahead = np.array([math.cos(spot.normal_rad), math.sin(spot.normal_rad), 0.0])
        x, y, z = (float(v) for v in np.array(spot.centre) + ahead * THICKNESS_M / 2)
        plate = Box(
            (x, y, z),
            (THICKNESS_M, PLATE_M, PLATE_M),
            spot.normal_rad,
            "plaster/white",
            f"tag/{identity}",
        )
        plates.append(StaticObject(f"tag {identity}", (plate,), 0.7, wall=True))
        x, y, z = (float(v) for v in np.array(spot.centre) + ahead * THICKNESS_M)
        landmarks.append(Landmark(identity, (x, y, z), SIDE_M))
    return tuple(plates), tuple(landmarks)


def _inside(shape: Shape, extent: Extent) -> bool:
    return extent[0] < shape.centre[0] < extent[2] and extent[1] < shape.centre[1] < extent[3]


def _spots(extent: Extent, shapes: list[Shape]) -> list[_Spot]:
    """Spots every 30 cm along vertical faces that can carry a plate and are not covered by another shape."""
    spots = []
    middles = np.array([shape.centre[:2] for shape in shapes]).reshape(-1, 2)
    reaches = np.array(
        [np.hypot(*(outline(one) - m).T).max() for one, m in zip(shapes, middles, strict=True)]
    )
    for box in shapes:
        if not isinstance(box, Box) or box.top_m < 0.20 + PLATE_M or box.bottom_m > 0.1:
            continue
        height = min(0.45, box.top_m - PLATE_M / 2 - 0.02)
        for turn, depth, width in (
            (0.0, box.size[0], box.size[1]),
            (math.pi / 2, box.size[1], box.size[0]),
            (math.pi, box.size[0], box.size[1]),
            (-math.pi / 2, box.size[1], box.size[0]),
        ):
            if width < PLATE_M + 0.02:
                continue
            normal = box.yaw_rad + turn
            ahead = np.array([math.cos(normal), math.sin(normal)])
            along = np.array([-ahead[1], ahead[0]])
            reach = (width - PLATE_M) / 2 - 0.01
            for shift in np.linspace(-reach, reach, max(1, int(2 * reach / 0.30) + 1)):
                at = np.array(box.centre[:2]) + ahead * depth / 2 + along * float(shift)
                near = np.hypot(*(middles - at).T) < reaches + SPACE_M
                close = [shapes[k] for k in np.flatnonzero(near)]
                if _uncovered(at, ahead, along, height, extent, close, box):
                    spots.append(_Spot((float(at[0]), float(at[1]), height), normal))
    return spots


def _uncovered(
    at: Float[np.ndarray, "2"],
    ahead: Float[np.ndarray, "2"],
    along: Float[np.ndarray, "2"],
    height: float,
    extent: Extent,
    shapes: list[Shape],
    own: Shape,
) -> bool:
    """Whether the plate lies in the room with 10 cm of free space in front of it."""
    x0, y0, x1, y1 = extent
    samples = np.array(
        [at + ahead * d + along * WIDE_M * s for d in (0.02, AHEAD_M) for s in (-1.0, 0.0, 1.0)]
    )
    within = (samples > [x0, y0]) & (samples < [x1, y1])
    if not within.all():
        return False
    for shape in shapes:
        if shape is own or shape.top_m < height - PLATE_M / 2 - 0.05:
            continue
        if shape.bottom_m > height + PLATE_M / 2:
            continue
        if (distance(shape, samples) < 0.0).any():
            return False
    return True


def _visible(
    places: Float[np.ndarray, "n 2"], spots: list[_Spot], shapes: list[Shape]
) -> Bool[np.ndarray, "n k"]:
    """Visibility of spots from places: within range, at a moderate viewing angle, not occluded."""
    centres = np.array([spot.centre[:2] for spot in spots]).reshape(-1, 2)
    normals = np.array([[math.cos(s.normal_rad), math.sin(s.normal_rad)] for s in spots])
    centres = centres + 0.01 * normals.reshape(-1, 2)
    ray = centres[None] - places[:, None]
    reach = np.linalg.norm(ray, axis=2)
    facing = -(ray * normals[None]).sum(axis=2) / np.maximum(reach, 1e-9)
    seen = (reach < IN_VIEW_M) & (reach > 0.4) & (facing > math.cos(math.radians(OBLIQUE_DEG)))
    for shape in shapes:
        if shape.top_m > OCCLUDING_M and shape.bottom_m < OCCLUDING_M + 0.2:
            seen &= ~_crosses(places, ray, outline(shape))
    return np.asarray(seen)


def _crosses(
    origin: Float[np.ndarray, "n 2"],
    ray: Float[np.ndarray, "n k 2"],
    corners: Float[np.ndarray, "c 2"],
) -> Bool[np.ndarray, "n k"]:
    """Whether the segment from each origin along each of its rays meets a convex outline."""
    enter = np.zeros(ray.shape[:2])
    leave = np.ones(ray.shape[:2])
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        outward = np.array([b[1] - a[1], a[0] - b[0]])  # corners run counter-clockwise
        height = (origin - a) @ outward
        speed = ray @ outward
        with np.errstate(divide="ignore", invalid="ignore"):
            when = -height[:, None] / speed
        enter = np.where(speed < 0, np.maximum(enter, when), enter)
        leave = np.where(speed > 0, np.minimum(leave, when), leave)
        leave = np.where((speed == 0) & (height[:, None] > 0), -1.0, leave)
    return np.asarray(enter < leave)
