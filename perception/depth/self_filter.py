"""The self-filter: pixels that show, or may show, the robot's own body are removed from an image.

A part of the body is the convex hull of its corners, so its picture is the convex hull of their pixels, with edges that
the distortion of the lens bends. Each corner grows
by the part's margin and by three standard deviations of its direction from the camera, and the picture by the pixels over
which the sensor mixes the part with what is behind it. So neither depth on the body nor the flying pixels at its edges
become obstacles. Behind the body nothing is known, as behind any other thing.

Source: ours.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from ..primitives.camera import Camera
from ..primitives.frame import ColourView, Depth
from ..primitives.own_body import JointReading, OwnBody
from ..primitives.pose import Pose3

SIGMAS = 3.0  # ours: of the direction of a part
NEAR_M = 0.02  # ours: what is nearer to the plane of the lens is not in the picture
ROUNDED_PX = 0.5  # OpenCV's corners are whole pixels
FARTHEST_PX = 30_000.0  # OpenCV's coordinates have 16 bits
PIECES = 33  # ours: of an edge; straight to 0.1 px in an image 640 px wide
BESIDE = 1.1
"""Ours: parts of the body are drawn to this multiple of the image's border, since their blur reaches into it."""
INSIDE = 1.0 - 1e-6  # ours: single precision stays within the largest slope
FIELD_CORNERS = 128  # ours: of the circle of what a lens shows, to 0.03 %
CORNERS = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])


def silhouette(
    own: OwnBody, joints: JointReading, camera: Camera, T_body_camera: Pose3, mixed_px: float
) -> Bool[np.ndarray, "h w"]:
    """The pixels of a camera that may show the robot itself.

    Args:
        own: The body.
        joints: Its measured angles.
        camera: Intrinsics.
        T_body_camera: By the same angles.
        mixed_px: Radius within which a pixel takes in its neighbours.

    Raises:
        InputError: The body has another number of joints.
    """
    mask = np.zeros((camera.height, camera.width), np.uint8)
    T_camera_body = T_body_camera.inverse()
    sides = _sides(camera, mixed_px)
    for part, corners in zip(own.parts, own.corners(joints), strict=True):
        points = T_camera_body.apply(corners)
        reach_m = part.margin_m + SIGMAS * part.angle_sigma_rad * np.linalg.norm(points, axis=1)
        if _outside(sides, points, float(reach_m.max())):
            continue
        cubes = (points[:, None] + reach_m[:, None, None] * CORNERS).reshape(-1, 3)
        front = _in_front(cubes)
        if camera.is_distorted:
            _fill_bent(mask, front, camera, mixed_px + ROUNDED_PX)
            continue
        pixels = np.clip(camera.project(front), -FARTHEST_PX, FARTHEST_PX)
        rim = cv2.convexHull(pixels.astype(np.float32))[:, 0]
        discs = (rim[:, None] + (mixed_px + ROUNDED_PX) * CORNERS[::2, :2]).reshape(-1, 2)
        cv2.fillConvexPoly(mask, cv2.convexHull(np.rint(discs).astype(np.int32)), 1)
    return mask.astype(np.bool_)


def without_self(
    depth: Depth, own: OwnBody | None, joints: JointReading | None, mixed_px: float
) -> Depth:
    """The depth image without the pixels of the robot itself; unchanged where its pose is not known."""
    if own is None or joints is None or depth.T_body_camera is None:
        return depth
    mask = silhouette(own, joints, depth.camera, depth.T_body_camera, mixed_px)
    if not mask.any():
        return depth
    z, sigma = depth.z.copy(), depth.sigma.copy()
    z[mask] = sigma[mask] = np.nan
    return replace(depth, z=z, sigma=sigma)


def blackened(view: ColourView, own: OwnBody | None, joints: JointReading | None) -> ColourView:
    """The picture with the robot itself in black, which has no colour and no marks."""
    if own is None or joints is None or view.T_body_camera is None:
        return view
    mask = silhouette(own, joints, view.camera, view.T_body_camera, 1.0)
    if not mask.any():
        return view
    rgb = view.rgb.copy()
    rgb[mask] = 0
    return replace(view, rgb=rgb)


def _fill_bent(
    mask: UInt8[np.ndarray, "h w"],
    points: Float[np.ndarray, "n 3"],
    camera: Camera,
    grown_px: float,
) -> None:
    """Mark the picture of a convex part, grown, in the image of a lens with distortion.

    Args:
        mask: Set to 1 there.
        points: Corners of the part in front of the lens, camera frame, m.
        camera: Intrinsics.
        grown_px: Width by which the picture grows.
    """
    hull = cv2.convexHull((points[:, :2] / points[:, 2:]).astype(np.float32))[:, 0]
    corners = _within(hull.astype(np.float64), _field(camera))
    if not len(corners):
        return
    steps = np.roll(corners, -1, axis=0) - corners
    rim = (corners[:, None] + steps[:, None] * np.linspace(0, 1, PIECES)[:, None]).reshape(-1, 2)
    pixels = camera.project(np.column_stack([rim, np.ones(len(rim))]))
    wide = math.ceil(grown_px)
    pad = (
        wide + 1
    )  # OpenCV cuts lines at whole pixels of the border, and so draws them there a pixel off
    padded = np.zeros((camera.height + 2 * pad, camera.width + 2 * pad), np.uint8)
    cv2.fillPoly(padded, [np.rint(pixels + pad).astype(np.int32)], 1)
    grown = cv2.dilate(padded, np.ones((2 * wide + 1, 2 * wide + 1), np.uint8))
    mask |= grown[pad:-pad, pad:-pad]


@cache
def _field(camera: Camera) -> float:
    """Radius of a circle of ray slopes x/z, y/z around all that a lens with distortion shows."""
    x, y = camera.slopes
    return min(camera.largest_slope, BESIDE * float(np.nanmax(np.hypot(x, y)))) * INSIDE


def _within(polygon: Float[np.ndarray, "n 2"], radius: float) -> Float[np.ndarray, "m 2"]:
    """Corners of the part of a convex polygon within a circle around 0: the hull of what each has inside the other."""
    steps = np.roll(polygon, -1, axis=0) - polygon
    a, b = np.sum(steps**2, axis=1), np.sum(polygon * steps, axis=1)
    root = b**2 - a * (np.sum(polygon**2, axis=1) - radius**2)
    meets = (root > 0.0) & (a > 0.0)
    start, step, a, b = polygon[meets], steps[meets], a[meets, None], b[meets, None]
    share = np.clip((-b + np.array([-1.0, 1.0]) * np.sqrt(root[meets])[:, None]) / a, 0.0, 1.0)
    inside = share[:, 0] < share[:, 1]
    ends = start[inside, None] + share[inside][..., None] * step[inside, None]
    angles = np.linspace(0, math.tau, FIELD_CORNERS, endpoint=False)
    circle = radius * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    away = circle[:, None] - polygon
    turn = steps[:, 0] * away[..., 1] - steps[:, 1] * away[..., 0]
    covered = (turn >= 0.0).all(axis=1) | (turn <= 0.0).all(axis=1)
    both = np.concatenate([ends.reshape(-1, 2), circle[covered]]).astype(np.float32)
    return cv2.convexHull(both)[:, 0].astype(np.float64) if len(both) else both.astype(np.float64)


def _sides(camera: Camera, mixed_px: float) -> Float[np.ndarray, "4 3"]:
    """Inward unit normals of the four planes through the lens and a border of the image."""
    x, y = camera.slopes
    across, down = (mixed_px + 0.5) / camera.fx, (mixed_px + 0.5) / camera.fy
    left, right = float(x.min()) - across, float(x.max()) + across
    top, bottom = float(y.min()) - down, float(y.max()) + down
    planes = np.array([[1.0, 0, -left], [-1.0, 0, right], [0, 1.0, -top], [0, -1.0, bottom]])
    return np.asarray(planes / np.linalg.norm(planes, axis=1, keepdims=True))


def _outside(
    sides: Float[np.ndarray, "4 3"], points: Float[np.ndarray, "n 3"], reach_m: float
) -> bool:
    """Whether a part with its reach lies behind the lens, or beyond one border of the image."""
    beyond = (points @ sides.T).max(axis=0) < -reach_m
    return bool(beyond.any() or points[:, 2].max() + reach_m < NEAR_M)


def _in_front(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "m 3"]:
    """Corners of a convex part cut off at the plane `NEAR_M` before the lens, camera frame, m."""
    front = points[:, 2] >= NEAR_M
    ahead, behind = points[front], points[~front]
    if not len(behind) or not len(ahead):
        return ahead
    share = (ahead[:, None, 2] - NEAR_M) / (ahead[:, None, 2] - behind[None, :, 2])
    cut = ahead[:, None] + share[..., None] * (behind[None] - ahead[:, None])
    return np.concatenate([ahead, cut.reshape(-1, 3)])
