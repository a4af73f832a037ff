"""A box on the floor from one depth image: its pose, length, width and height.

A view shows faces and an outline of a box. A visible face locates one side without bias. A side that faces
away is known by the outline alone: there the box ends half a pixel beyond its last pixel, and a mixed pixel
lies at the edge. Pixel centres would make a box one pixel too small. Sides that neither a face nor the outline
shows stay unknown, and are reported as such.

Source: ours; initial heading after Zhang, Xu, Dong and Dolan 2017 (closeness).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int32
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from perception.depth.points import organised
from perception.floor import levelling
from perception.primitives.errors import InputError
from perception.primitives.frame import Depth
from perception.primitives.plane import Plane
from perception.primitives.pose import Pose3

from ..panorama.silhouettes import INNER_PX, row_ends

Points3 = Float[np.ndarray, "n 3"]

FLOOR_M = 0.03  # seed 004 as specified: lower points are floor
FLOOR_SIGMAS = 3.0  # ours: or points lower than this many standard deviations
FARTHEST_M = 4.0  # ours: beyond, a pixel of a structured light camera is 3 cm deep
STEP_M = 0.02  # ours: connected pixels differ in depth by less, plus
STEP_SHARE = 0.02  # ours: this share of their depth
LEAST_PX = 400  # ours: fewer pixels show no box
TOP_M = 0.015  # ours: half the thickness of the layer of points on the top
GATES_M = (0.08, 0.05, 0.03, 0.02, 0.02, 0.02)  # ours: of points about a side, per iteration
LEAST_POINTS = 12  # ours: to locate a side
MOST_POINTS = 600  # ours: of faces; more add no information
THIN_M = 0.03  # ours: sides this close may be one side seen frontally
LEAST_SHARE = 0.05  # ours: of the outline that must lie on a side without a face
CORRELATED = 25.0  # ours: neighbouring points with common errors, which count as one
RANGE_SHARE = 0.004  # ours: common relative error of all depths of a view


@dataclass(frozen=True)
class Cuboid:
    """A box on the floor.

    Args:
        T_camera_box: Pose of the box in the camera frame: origin on the floor below its centre, x along
            the length, z up.
        length_m: The longer side.
        width_m: The shorter side.
        height_m: Height of its top above the floor.
        sigma_length_m, sigma_width_m, sigma_height_m: Standard deviations.
        seen_length, seen_width: Whether both ends of that side are known; else it is a lower bound.
        cut: Whether the image border cuts it, or a nearer object occludes part of its outline.
        top: Whether its upper face is seen.
    """

    T_camera_box: Pose3
    length_m: float
    width_m: float
    height_m: float
    sigma_length_m: float
    sigma_width_m: float
    sigma_height_m: float
    seen_length: bool
    seen_width: bool
    cut: bool
    top: bool


def label_objects(
    depth: Depth, floor: Plane, farthest_m: float = FARTHEST_M
) -> Int32[np.ndarray, "h w"]:
    """Label objects on the floor that are connected in depth, from 1 by falling size; 0 for the rest.

    Args:
        depth: One view.
        floor: In the camera frame, with covariance.
        farthest_m: Pixels beyond this depth get no label.
    """
    xyz = organised(depth).astype(np.float64)
    height, z = floor.distance(xyz), depth.z
    noise = np.hypot(depth.sigma * floor.offset_m / z, math.sqrt(max(floor.covariance[2, 2], 0.0)))
    with np.errstate(invalid="ignore"):
        standing = (height > np.maximum(FLOOR_M, FLOOR_SIGMAS * noise)) & (z < farthest_m)
    number = np.arange(z.size).reshape(z.shape)
    links = []
    for here, there in (
        ((slice(None), slice(1, None)), (slice(None), slice(None, -1))),
        ((slice(1, None), slice(None)), (slice(None, -1), slice(None))),
    ):
        with np.errstate(invalid="ignore"):
            close = np.abs(z[here] - z[there]) < STEP_M + STEP_SHARE * z[here]
        met = standing[here] & standing[there] & close
        links.append(np.stack([number[here][met], number[there][met]]))
    i, j = np.concatenate(links, axis=1)
    graph = coo_array((np.ones(i.size, np.int8), (i, j)), shape=(z.size, z.size))
    _, part = connected_components(graph, directed=False)
    part = np.where(standing.ravel(), part, -1)
    names, count = np.unique(part[part >= 0], return_counts=True)
    order = np.argsort(-count, kind="stable")
    order = order[count[order] >= LEAST_PX]
    rank = np.zeros(int(part.max(initial=-1)) + 2, np.int32)
    rank[names[order]] = np.arange(1, order.size + 1)
    return rank[part].reshape(z.shape)


def fit(depth: Depth, floor: Plane, mask: Bool[np.ndarray, "h w"]) -> Cuboid | None:
    """Fit a box to one object.

    Args:
        depth: One view.
        floor: In the camera frame, with covariance.
        mask: Its pixels, see `label_objects`.

    Returns:
        None if too few pixels or points show it.

    Raises:
        InputError: The mask has another shape than the image.
    """
    if mask.shape != depth.z.shape:
        raise InputError(f"cuboid: mask of {mask.shape} px for depth of {depth.z.shape}")
    mask = mask & np.isfinite(depth.z)
    if int(mask.sum()) < LEAST_PX:
        return None
    T_body_camera = levelling.camera_above_floor(floor)
    inside = T_body_camera.apply(organised(depth)[mask].astype(np.float64))
    outline, cut, pitch = _outline(depth, mask, T_body_camera)
    if len(outline) < LEAST_POINTS:
        return None
    top_m, sigma_top, is_top = _top(inside, outline, pitch)
    faces = inside[(inside[:, 2] > FLOOR_M) & (inside[:, 2] < top_m - 2.0 * TOP_M)]
    faces = faces[:: max(1, len(faces) // MOST_POINTS)]
    ends = outline[outline[:, 2] > FLOOR_M]
    sides = _sides(ends, faces)
    reach = float(np.median(np.linalg.norm(inside, axis=1)))
    return _cuboid(sides, (top_m, sigma_top, is_top), cut, reach, pitch, floor)


def _outline(
    depth: Depth, mask: Bool[np.ndarray, "h w"], T_body_camera: Pose3
) -> tuple[Points3, bool, float]:
    """Edge points of the object in rows and columns, body frame; whether it is cut; width of a pixel, m."""
    camera = depth.camera
    height, width = mask.shape
    found, free = [], []
    for turned in (False, True):
        for flipped in (False, True):
            m, z = (mask.T, depth.z.T) if turned else (mask, depth.z)
            if flipped:
                m, z = m[:, ::-1], z[:, ::-1]
            lines = np.flatnonzero(m.sum(axis=1) >= INNER_PX)
            if lines.size == 0:
                continue
            end, own, hidden, outside = row_ends(m[lines], z[lines])
            at = z.shape[1] - 1 - end if flipped else end
            u, v = (lines.astype(float), at) if turned else (at, lines.astype(float))
            on_border = (u < 1.0) | (v < 1.0) | (u > width - 2.0) | (v > height - 2.0)
            found.append(camera.back_project(np.column_stack([u, v]), own))
            free.append(~(hidden | outside | on_border))
    if not found:
        return np.zeros((0, 3)), True, 0.0
    points, usable = np.concatenate(found), np.concatenate(free)
    pitch = float(np.median(points[:, 2])) / camera.fx
    body = T_body_camera.apply(points)
    standing = body[:, 2] > FLOOR_M + 0.01  # at its base the floor in front is nearer
    cut = bool(np.mean(~usable[standing]) > 0.1) if standing.any() else True
    return body[usable], cut, pitch


def _top(
    inside: Points3, outline: Float[np.ndarray, "m 3"], pitch: float
) -> tuple[float, float, bool]:
    """Height of the top, its standard deviation, and whether the upper face is seen."""
    height = inside[:, 2]
    highest = float(np.quantile(height, 0.98))
    centre = _mode(height[height > highest - 0.05], TOP_M)
    on_top = np.abs(height - centre) <= TOP_M
    upright = 2.0 * TOP_M / max(highest, 0.05)  # share of points there if only a front is seen
    if np.mean(on_top) > max(3.0 * upright, 0.1):
        for _ in range(3):
            centre = float(np.median(height[np.abs(height - centre) <= TOP_M]))
        return centre, 0.002, True
    rim = outline[:, 2]
    rim = rim[rim > 0.6 * highest]
    if rim.size < LEAST_POINTS:
        return highest, TOP_M, False
    edge = _mode(rim, 2.0 * pitch)
    near = rim[np.abs(rim - edge) <= 2.0 * pitch]
    spread = float(near.std()) / math.sqrt(max(near.size / CORRELATED, 1.0))
    return float(near.mean()), math.hypot(spread, 0.3 * pitch), False


def _mode(values: Float[np.ndarray, "n"], half: float) -> float:
    """Median of the densest window of width 2 * half."""
    ordered = np.sort(values)
    if ordered.size == 0:
        return 0.0
    count = np.searchsorted(ordered, ordered + 2.0 * half, side="right") - np.arange(ordered.size)
    first = int(np.argmax(count))
    return float(np.median(ordered[first : first + count[first]]))


@dataclass(frozen=True, eq=False)
class _Sides:
    """Heading, the four sides in rotated axes (x low, x high, y low, y high), their sigmas and evidence."""

    yaw: float
    at: Float[np.ndarray, "4"]
    sigma: Float[np.ndarray, "4"]
    known: Bool[np.ndarray, "4"]
    by_face: Bool[np.ndarray, "4"]


def _heading(plan: Float[np.ndarray, "n 2"]) -> float:
    """Initial heading: its rectangle has the most points close to its sides."""
    plan = plan[:: max(1, len(plan) // 400)]
    best, chosen = -1.0, 0.0
    for degrees in range(90):
        yaw = math.radians(degrees)
        turned = plan @ _axes(yaw)
        low, high = np.percentile(turned, (1.0, 99.0), axis=0)
        off = np.minimum(np.abs(turned - low), np.abs(high - turned)).min(axis=1)
        score = float(np.sum(1.0 / np.maximum(off, 0.01)))
        if score > best:
            best, chosen = score, yaw
    return chosen


def _axes(yaw: float) -> Float[np.ndarray, "2 2"]:
    """Coordinates times this matrix are those in axes rotated by yaw."""
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([[c, -s], [s, c]])


def _sides(ends: Points3, faces: Float[np.ndarray, "m 3"]) -> _Sides:
    """Heading and sides by reweighted least squares of the points of faces and outline."""
    plan = np.concatenate([ends[:, :2], faces[:, :2]])
    is_face = np.arange(len(plan)) >= len(ends)
    yaw = _heading(plan)
    turned = plan @ _axes(yaw)
    low, high = np.percentile(turned, (2.0, 98.0), axis=0)
    at = np.array([low[0], high[0], low[1], high[1]])
    sigma, known, by_face = np.full(4, np.inf), np.zeros(4, bool), np.zeros(4, bool)
    for gate in GATES_M:
        turned = plan @ _axes(yaw)
        rows, targets = [], []
        hessian_count = np.zeros(4)
        for side in range(4):
            axis, other = side // 2, 1 - side // 2
            span = at[2 * other], at[2 * other + 1]
            off = turned[:, axis] - at[side]
            along = turned[:, other]
            near = (np.abs(off) <= gate) & (along > span[0] - gate) & (along < span[1] + gate)
            inner = (along > span[0] + 0.03) & (along < span[1] - 0.03)
            face = near & is_face & inner
            by_face[side] = int(face.sum()) >= 3 * LEAST_POINTS
            used = face if by_face[side] else near & ~is_face
            least = LEAST_POINTS if by_face[side] else LEAST_SHARE * len(ends)
            known[side] = int(used.sum()) >= max(LEAST_POINTS, least)
            hessian_count[side] = used.sum()
            if not known[side]:
                continue
            # rotating the axes by d moves a point by +along d in x, -along d in y
            row = np.zeros((int(used.sum()), 5))
            row[:, side] = 1.0
            row[:, 4] = -along[used] if axis == 0 else along[used]
            weight = 1.0 / np.maximum(np.abs(off[used]), 0.005) / math.sqrt(used.sum())
            rows.append(row * np.sqrt(weight)[:, None])
            targets.append(off[used] * np.sqrt(weight))
        if not rows:
            break
        matrix = np.concatenate(rows)
        step = np.linalg.lstsq(matrix, np.concatenate(targets), rcond=1e-6)[0]
        at = at + step[:4]
        yaw += float(np.clip(step[4], -0.1, 0.1))
        with np.errstate(divide="ignore"):
            sigma = 0.01 / np.sqrt(np.maximum(hessian_count / CORRELATED, 1e-3))
    return _Sides(yaw, at, sigma, known, by_face)


def _cuboid(
    sides: _Sides,
    top: tuple[float, float, bool],
    cut: bool,
    reach: float,
    pitch: float,
    floor: Plane,
) -> Cuboid | None:
    size = np.maximum(sides.at[1::2] - sides.at[::2], 0.0)
    if not np.any(size > THIN_M):
        return None
    own = np.where(sides.by_face, 0.0, 0.5 * pitch)
    sigmas = np.hypot(sides.sigma, own)
    spread = np.hypot(sigmas[::2], sigmas[1::2])
    spread = np.hypot(spread, RANGE_SHARE * np.maximum(reach, size))
    seen = sides.known[::2] & sides.known[1::2] & (size > THIN_M)
    centre_xy = _axes(sides.yaw) @ (0.5 * (sides.at[1::2] + sides.at[::2]))
    long = int(np.argmax(size))
    heading = sides.yaw + (math.pi / 2.0 if long == 1 else 0.0)
    half = 0.5 * heading
    T_body_box = Pose3(
        (float(centre_xy[0]), float(centre_xy[1]), 0.0), (0.0, 0.0, math.sin(half), math.cos(half))
    )
    lever = np.array([reach, reach, 1.0])
    sigma_floor = math.sqrt(max(float(np.sum(np.diag(floor.covariance) * lever**2)), 0.0))
    return Cuboid(
        levelling.camera_above_floor(floor).inverse() @ T_body_box,
        float(size[long]),
        float(size[1 - long]),
        top[0],
        float(spread[long]),
        float(spread[1 - long]),
        math.hypot(math.hypot(top[1], sigma_floor), RANGE_SHARE * reach),
        bool(seen[long]),
        bool(seen[1 - long]),
        cut,
        top[2],
    )
