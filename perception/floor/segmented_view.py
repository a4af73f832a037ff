"""A classified depth image, and the queries that the pipeline makes on it.

Which points are at a truncation of the view, which belong to moving obstacles, which places are visible, and the
colour of each point.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Int, UInt8

from ..depth.points import Points
from ..depth.reach import ReachConfig
from ..primitives.frame import ColourView, Depth
from ..primitives.obstacle import Obstacle
from ..primitives.plane import Plane
from ..primitives.pose import Pose3
from . import classify

UPPER_ROWS = 2  # ours: of an image; what reaches them goes on above it
KNEE_M = 0.15  # height at which a tracked obstacle is expected: every relevant one reaches it
BEYOND_M = 0.15  # a depth this far behind a place shows that the place is free
BORDER_SHARE = 0.02  # of the image width, and of its height
HIDING_SHARE = 0.02  # of the image width: distance in the image from an occluding object
NEAR_M = 0.03  # of points this close to the least depth, the front may be missing
BESIDE_M = 0.04  # distance beside a border point at which another view must have a depth
CUT_M = 0.10  # least depth step of an occlusion; distance from the largest depth used
HOLE_M, HOLE_KNOWN = 0.15, 0.2
"""Ours: least width of a hole in the depth of a stereo pair, at the depth of the point beside it, and the share of its
pixels that may have a depth. The shadow beside an object, which one camera alone sees, is at most as wide as the baseline."""
WHOLE, CUT, HOLE = -1, -2, -3
"""A point at which nothing ends, one at which its object ends, and one beside a hole."""
MOVES = 0.5  # ours: probability from which the map treats an obstacle as moving
MARGIN_M = 0.06  # ours: position error of a track and noise of the points
BEHIND_M = 0.05  # ours: beside its noise, how much farther a depth is that shows a point to be free
ASIDE_M = 0.02  # ours: error of a pose, and width of the mixed pixels at an edge
ASIDE = ASIDE_M * np.array([[0, 0, 0], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]], np.float64)


@dataclass(frozen=True)
class SegmentedView:
    """One depth image with its classified points.

    Args:
        sensor: "tof", "stereo" or "depth".
        depth: The image.
        points: Camera frame, m.
        classes: A constant of `classify` for each point.
        floor: Measured floor, camera frame; the prior one if no floor was found.
        seen: Share of the points on the floor; None if no floor was found.
        T_map_camera: Pose of the camera in the upright map frame.
        upright: (n, 3) points in the map frame, m; z is the height above the floor.
    """

    sensor: str
    depth: Depth
    points: Points
    classes: Int[np.ndarray, "n"]
    floor: Plane
    seen: float | None
    T_map_camera: Pose3
    upright: Float[np.ndarray, "n 3"]

    @property
    def rising(self) -> Int[np.ndarray, "k"]:
        """Indices of the points of obstacles: their low part and the body above."""
        return np.flatnonzero(
            (self.classes == classify.OBSTACLE) | (self.classes == classify.OVERHANG)
        )


def truncated(
    view: SegmentedView,
    points: Points,
    reach: ReachConfig,
    others: Sequence[SegmentedView] = (),
) -> Int[np.ndarray, "n"]:
    """Where the visible part of an object may end: at the image border, the depth range, or something nearer.

    A border point does not count if another view of the frame has a depth beyond it. The left border of a
    stereo pair is where its right image ends.

    Args:
        view: The view.
        points: Points of it, camera frame.
        reach: Range of depths used.
        others: Other views of the same frame.

    Returns:
        For each point `WHOLE`, `CUT`, or the index of the nearer point beside it: the object ends there unless both
        points are its own. An edge has mixed pixels behind it, which are of the same object. `HOLE` where a
        stereo pair has no depth to its left or right: without texture the object may go on there. Other sensors have
        no depth where there is nothing in range.
    """
    camera, depth = view.depth.camera, view.depth
    image = _upright(view, points)
    margin = BORDER_SHARE * image.z.shape[1]
    left = image.column < margin
    border = left | (image.column > image.z.shape[1] - 1 - margin)
    outward = np.where(left[:, None], -image.right, image.right)
    if depth.baseline_m > 0.0:
        reach_px = BORDER_SHARE * camera.width + camera.fx * depth.baseline_m / points.xyz[:, 2]
        blind = points.pixels % camera.width < reach_px
        border |= blind
        outward[blind] = (-1.0, 0.0, 0.0)
    beyond = points.xyz[border] + BESIDE_M * outward[border]
    border[border] = ~_has_depth(view.T_map_camera.apply(beyond), others)
    z = points.xyz[:, 2]
    ends = (z < reach.nearest_m + NEAR_M) | (z > reach.farthest_m - CUT_M)
    found = _hiders(image, reach.stride)
    for side, beside in _beside_holes(depth, image, z):
        hole = np.flatnonzero((found == WHOLE) & beside)
        beyond = points.xyz[hole] + side * BESIDE_M * image.right
        found[hole[~_has_depth(view.T_map_camera.apply(beyond), others)]] = HOLE
    found[border | ends] = CUT
    return found


def uppermost(view: SegmentedView, points: Points) -> Bool[np.ndarray, "n"]:
    """Which points of a view lie at the upper border of its image."""
    return _upright(view, points).row < UPPER_ROWS


def lowermost(
    view: SegmentedView,
    points: Points,
    reach: ReachConfig,
    others: Sequence[SegmentedView] = (),
) -> Bool[np.ndarray, "n"]:
    """Which points of a view lie at the lower border of its image, and no other view has a depth below them."""
    image = _upright(view, points)
    height = len(image.z)
    found = image.row > height - 1 - max(BORDER_SHARE * height, reach.stride)
    below = points.xyz[found] + BESIDE_M * image.down
    found[found] = ~_has_depth(view.T_map_camera.apply(below), others)
    return found


class _Upright(NamedTuple):
    """A depth image turned by quarter turns so that up is up.

    Args:
        z: Depth, m.
        row, column: Of each point.
        right, down: Directions in this image, camera frame.
    """

    z: Float32[np.ndarray, "h w"]
    row: Int[np.ndarray, "n"]
    column: Int[np.ndarray, "n"]
    right: Float[np.ndarray, "3"]
    down: Float[np.ndarray, "3"]


def _upright(view: SegmentedView, points: Points) -> _Upright:
    """The image of a camera that may hang on its side or upside down, with the places of points of it."""
    x, y = view.floor.normal[:2]
    turns = (0 if y <= 0.0 else 2) if abs(y) >= abs(x) else (1 if x > 0.0 else 3)
    row, column = np.divmod(points.pixels, view.depth.camera.width)
    right, down = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
    height, width = view.depth.z.shape
    for _ in range(turns):  # to the left
        row, column = width - 1 - column, row
        right, down = down, -right
        height, width = width, height
    return _Upright(np.rot90(view.depth.z, turns), row, column, right, down)


def _beside_holes(
    depth: Depth, image: _Upright, z: Float[np.ndarray, "n"]
) -> Iterator[tuple[int, Bool[np.ndarray, "n"]]]:
    """Side, -1 for left and 1 for right, and which points at depth z have hardly any depth there; of stereo pairs only."""
    if depth.baseline_m <= 0.0:
        return
    height, width = image.z.shape
    known = np.zeros((height, width + 1), np.int32)
    np.cumsum(np.isfinite(image.z), axis=1, out=known[:, 1:])
    reach_px = max(HOLE_M, depth.baseline_m) * depth.camera.fx / z
    for side in (-1, 1):
        first = image.column + (side > 0)
        last = np.clip((first + side * reach_px).astype(np.int64), 0, width)
        count = np.abs(known[image.row, last] - known[image.row, first])
        pixels = np.abs(last - first)  # few where the image border is near: it cuts, not a hole
        yield side, (pixels >= 0.5 * reach_px) & (count <= HOLE_KNOWN * pixels)


def _hiders(image: _Upright, stride: int) -> Int[np.ndarray, "n"]:
    """Index of the nearest of the points beside each point, if something there is nearer than it by a step.

    `CUT` if what is nearest there is nearer by a step than all of these points, which are every n-th pixel alone.
    """
    width = image.z.shape[1]
    half = max(1, round(HIDING_SHARE * width))
    measured = np.ascontiguousarray(np.where(np.isfinite(image.z), image.z, np.float32(np.inf)))
    kernel = np.ones((1, 2 * half + 1), np.uint8)
    places = image.row * width + image.column
    nearest = cv2.erode(measured, kernel).ravel()[places]
    hidden = np.flatnonzero(measured.ravel()[places] - nearest > CUT_M)
    found = np.full(len(places), WHOLE)
    pixels = places[hidden, None]
    beside = np.arange(1 - half - stride, half + stride) + pixels % width
    beside = np.clip(beside, 0, width - 1) + pixels - pixels % width
    own = np.full(measured.size, np.float32(np.inf))
    own[places] = measured.ravel()[places]
    hiders = beside[np.arange(len(hidden)), np.argmin(own[beside], axis=1)]
    among = own[hiders] - nearest[hidden] <= CUT_M
    order = np.argsort(places, kind="stable")
    rank = np.searchsorted(places[order], hiders)
    found[hidden] = np.where(among, order[np.minimum(rank, len(order) - 1)], CUT)
    return found


def _has_depth(
    places: Float[np.ndarray, "n 3"], views: Sequence[SegmentedView]
) -> Bool[np.ndarray, "n"]:
    """Whether any of the views has a depth in the direction of places of the map."""
    found = np.zeros(len(places), dtype=bool)
    for view in views:
        inside, u, v = view.depth.camera.nearest_pixels(view.T_map_camera.inverse().apply(places))
        found |= inside & np.isfinite(view.depth.z[v, u])
    return found


@dataclass(frozen=True)
class _Image:
    """A depth image and where it was taken.

    Args:
        T_camera_map: The map in the camera frame.
        floor_m: Height of the floor below the camera in the map.
    """

    depth: Depth
    T_camera_map: Pose3
    floor_m: float


class Sight:
    """What the depth images of one frame say about places of the map: free, occupied, or unknown."""

    def __init__(self, views: Sequence[SegmentedView]) -> None:
        """Keep the images, not the points."""
        self._images = [
            _Image(
                view.depth,
                view.T_map_camera.inverse(),
                float(view.T_map_camera.translation[2]) - view.floor.offset_m,
            )
            for view in views
        ]

    def visible(self, xy: Float[np.ndarray, "n 2"]) -> Bool[np.ndarray, "n"]:
        """Which places of the map have a free line of sight, at the height of a knee."""
        seen = np.zeros(len(xy), dtype=bool)
        for image in self._images:
            knee = np.column_stack([xy, np.full(len(xy), image.floor_m + KNEE_M)])
            camera_points = image.T_camera_map.apply(knee)
            inside, u, v = image.depth.camera.nearest_pixels(camera_points)
            behind = image.depth.z[v, u]  # depth measured in that direction
            seen |= inside & (behind > camera_points[:, 2] + BEYOND_M)
        return seen

    def __call__(self, points: Float[np.ndarray, "n 3"]) -> tuple[int, int]:
        """How many points of the map are seen through, and how many are known to be occupied.

        A point is seen through if everything within `ASIDE_M` of its line of sight is farther away than the
        noise explains, so that neither an edge nor a small error of the pose frees it. It is occupied if the depth
        there is its own. It is neither if it is hidden, outside the images, without depth, or close before something.
        """
        free, occupied = np.zeros(len(points), dtype=bool), np.zeros(len(points), dtype=bool)
        for image in self._images:
            least = _beyond(image.depth, image.T_camera_map.apply(points))
            free |= least > 1.0
            occupied |= np.abs(least) <= 0.5
        return int(np.count_nonzero(free & ~occupied)), int(np.count_nonzero(occupied))


def sees_through(
    depth: Depth, T_map_camera: Pose3, camera_m: float, places: Float[np.ndarray, "n 3"]
) -> Bool[np.ndarray, "n"]:
    """Which places a depth image sees through, as `Sight` does.

    Args:
        depth: The image.
        T_map_camera: Where it was taken.
        camera_m: Height of the camera above the floor.
        places: Map frame, and height above the floor, m.
    """
    floor_m = np.array([0.0, 0.0, float(T_map_camera.translation[2]) - camera_m])
    return np.asarray(_beyond(depth, T_map_camera.inverse().apply(places + floor_m)) > 1.0)


def _beyond(depth: Depth, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
    """How far everything beside the line of sight to each point (camera frame, m) lies beyond it.

    In units of what noise explains; NaN where that is not known.
    """
    inside, u, v = depth.camera.nearest_pixels((points + ASIDE[:, None]).reshape(-1, 3))
    z, sigma = (layer[v, u].reshape(len(ASIDE), -1) for layer in (depth.z, depth.sigma))
    beyond = (z - points[:, 2]) / (BEHIND_M + 3.0 * sigma)
    known = inside.reshape(beyond.shape) & np.isfinite(beyond)
    return np.asarray(np.where(known, beyond, np.nan).min(axis=0))


def near_moving_obstacles(
    xy: Float[np.ndarray, "n 2"], obstacles: Sequence[Obstacle]
) -> Bool[np.ndarray, "n"]:
    """Points within the margin of an obstacle that probably moves."""
    near = np.zeros(len(xy), dtype=bool)
    for obstacle in obstacles:
        if obstacle.moving > MOVES:
            distance = np.linalg.norm(xy - obstacle.position, axis=1)
            near |= distance < obstacle.radius_m + MARGIN_M
    return near


def colours_of(
    points: Points, depth: Depth, colour: ColourView | None
) -> UInt8[np.ndarray, "n 3"] | None:
    """Colour of each point; grey outside the colour image; None without a colour camera."""
    if colour is None:
        return None
    xyz = points.xyz
    if depth.T_body_camera is not None and colour.T_body_camera is not None:
        T_colour_depth = colour.T_body_camera.inverse() @ depth.T_body_camera
        xyz = T_colour_depth.apply(xyz)
    inside, u, v = colour.camera.nearest_pixels(xyz)
    colours = colour.rgb.reshape(-1, 3).take(v * colour.rgb.shape[1] + u, axis=0)
    colours[~inside] = 128
    return colours
