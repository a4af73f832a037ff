"""A box that stands on the floor, from one view of it: height, length, width, and where it is.

What a view shows of a box are faces and an outline. A face says where one side is, without bias. A side
that faces away is known by the outline alone: there the last pixel that shows the box ends half a pixel
further out, and a mixed pixel lies between both; taken at pixel centres a box would come out too small by a
pixel. Sides that neither a face nor the outline shows stay unknown, and the box says so.

Source: ours; the first guess of the heading after Zhang, Xu, Dong and Dolan 2017 (closeness).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float, Int32
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from perception.depth.points import organised
from perception.floor import levelling
from perception.primitives.errors import ConfigError, InputError
from perception.primitives.frame import Depth
from perception.primitives.plane import Plane
from perception.primitives.pose import Pose3

from ..panorama.silhouettes import SilhouetteConfig, row_ends

Points3 = Float[np.ndarray, "n 3"]


@dataclass(frozen=True)
class CuboidConfig:
    """What stands, what hangs together, and which points belong to a side."""

    silhouettes: SilhouetteConfig = field(default_factory=SilhouetteConfig)
    floor_m: float = 0.03  # seed 004 as specified: lower is floor
    floor_sigmas: float = 3.0  # ours: or lower than this many deviations
    farthest_m: float = 4.0  # ours: beyond, a pixel of a structured light camera is 3 cm deep
    step_m: float = 0.02  # ours: neighbouring pixels of one thing differ by less, and
    step_share: float = 0.02  # ours: by this much of their depth
    least_px: int = 400  # ours: fewer show no box
    top_m: float = 0.015  # ours: half the thickness of what counts as the top
    gates_m: tuple[float, ...] = (
        0.08,
        0.05,
        0.03,
        0.02,
        0.02,
        0.02,
    )  # ours: points this near a side
    least_points: int = 12  # ours: that say where a side is
    most_points: int = 600  # ours: of faces; more say the same again
    thin_m: float = 0.03  # ours: sides so near to each other may be one, seen from in front
    least_share: float = 0.05  # ours: of the outline must lie on a side without a face
    alike: float = 25.0  # ours: neighbouring points err alike, so that many count as one
    range_share: float = 0.004  # ours: what all depths of a view are wrong by

    def __post_init__(self) -> None:
        for name in ("floor_m", "farthest_m", "step_m", "top_m", "alike"):
            if not getattr(self, name) > 0.0:
                raise ConfigError(f"cuboid: {name}={getattr(self, name)} must be positive")
        if self.least_px < 1 or self.least_points < 2 or not self.gates_m:
            raise ConfigError("cuboid: least_px, least_points and gates_m must not be empty")


@dataclass(frozen=True)
class Cuboid:
    """A box on the floor.

    Args:
        T_camera_box: Axes of the box in the camera frame: origin on the floor below its middle, x along
            the length, z up.
        length_m: The longer side.
        width_m: The shorter side.
        height_m: Of its top above the floor.
        sigma_length_m, sigma_width_m, sigma_height_m: Deviations.
        seen_length, seen_width: Whether both ends of that side are known; else it is a lower bound.
        cut: Whether the image's border cuts it, or something in front hides a part of its outline.
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


def things(
    depth: Depth, floor: Plane, config: CuboidConfig | None = None
) -> Int32[np.ndarray, "h w"]:
    """What stands on the floor and hangs together in depth, numbered from 1 by size; 0 for the rest.

    Args:
        depth: One view.
        floor: In the camera frame, with covariance.
        config: What counts.
    """
    config = config or CuboidConfig()
    xyz = organised(depth).astype(np.float64)
    height, z = floor.distance(xyz), depth.z
    noise = np.hypot(depth.sigma * floor.offset_m / z, math.sqrt(max(floor.covariance[2, 2], 0.0)))
    with np.errstate(invalid="ignore"):
        standing = (height > np.maximum(config.floor_m, config.floor_sigmas * noise)) & (
            z < config.farthest_m
        )
    number = np.arange(z.size).reshape(z.shape)
    links = []
    for here, there in (
        ((slice(None), slice(1, None)), (slice(None), slice(None, -1))),
        ((slice(1, None), slice(None)), (slice(None, -1), slice(None))),
    ):
        with np.errstate(invalid="ignore"):
            close = np.abs(z[here] - z[there]) < config.step_m + config.step_share * z[here]
        met = standing[here] & standing[there] & close
        links.append(np.stack([number[here][met], number[there][met]]))
    i, j = np.concatenate(links, axis=1)
    graph = coo_array((np.ones(i.size, np.int8), (i, j)), shape=(z.size, z.size))
    _, part = connected_components(graph, directed=False)
    part = np.where(standing.ravel(), part, -1)
    names, count = np.unique(part[part >= 0], return_counts=True)
    order = np.argsort(-count, kind="stable")
    order = order[count[order] >= config.least_px]
    rank = np.zeros(int(part.max(initial=-1)) + 2, np.int32)
    rank[names[order]] = np.arange(1, order.size + 1)
    return rank[part].reshape(z.shape)


def fit(
    depth: Depth, floor: Plane, mask: Bool[np.ndarray, "h w"], config: CuboidConfig | None = None
) -> Cuboid | None:
    """The box that one thing is.

    Args:
        depth: One view.
        floor: In the camera frame, with covariance.
        mask: Its pixels, as of `things`.
        config: Which points count.

    Returns:
        None if too little of it is seen.

    Raises:
        InputError: The mask is not of the image's shape.
    """
    config = config or CuboidConfig()
    if mask.shape != depth.z.shape:
        raise InputError(f"cuboid: mask of {mask.shape} px for depth of {depth.z.shape}")
    mask = mask & np.isfinite(depth.z)
    if int(mask.sum()) < config.least_px:
        return None
    T_body_camera = levelling.camera_above_floor(floor)
    inside = T_body_camera.apply(organised(depth)[mask].astype(np.float64))
    outline, cut, pitch = _outline(depth, mask, T_body_camera, config)
    if len(outline) < config.least_points:
        return None
    top_m, sigma_top, is_top = _top(inside, outline, pitch, config)
    faces = inside[(inside[:, 2] > config.floor_m) & (inside[:, 2] < top_m - 2.0 * config.top_m)]
    faces = faces[:: max(1, len(faces) // config.most_points)]
    ends = outline[outline[:, 2] > config.floor_m]
    sides = _sides(ends, faces, config)
    reach = float(np.median(np.linalg.norm(inside, axis=1)))
    return _cuboid(sides, (top_m, sigma_top, is_top), cut, reach, pitch, floor, config)


def _outline(
    depth: Depth, mask: Bool[np.ndarray, "h w"], T_body_camera: Pose3, config: CuboidConfig
) -> tuple[Points3, bool, float]:
    """Where rows and columns leave the thing, body frame; whether it is cut; width of a pixel there, m."""
    camera = depth.camera
    height, width = mask.shape
    found, free = [], []
    for turned in (False, True):
        for flipped in (False, True):
            m, z = (mask.T, depth.z.T) if turned else (mask, depth.z)
            if flipped:
                m, z = m[:, ::-1], z[:, ::-1]
            lines = np.flatnonzero(m.sum(axis=1) >= config.silhouettes.inner_px)
            if lines.size == 0:
                continue
            end, own, hidden, outside = row_ends(m[lines], z[lines], config.silhouettes)
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
    standing = body[:, 2] > config.floor_m + 0.01  # at its foot the floor in front is nearer
    cut = bool(np.mean(~usable[standing]) > 0.1) if standing.any() else True
    return body[usable], cut, pitch


def _top(
    inside: Points3, outline: Float[np.ndarray, "m 3"], pitch: float, config: CuboidConfig
) -> tuple[float, float, bool]:
    """Height of the top, its deviation, and whether the upper face is seen."""
    height = inside[:, 2]
    highest = float(np.quantile(height, 0.98))
    centre = _mode(height[height > highest - 0.05], config.top_m)
    on_top = np.abs(height - centre) <= config.top_m
    upright = 2.0 * config.top_m / max(highest, 0.05)  # share that a front alone would have there
    if np.mean(on_top) > max(3.0 * upright, 0.1):
        for _ in range(3):
            centre = float(np.median(height[np.abs(height - centre) <= config.top_m]))
        return centre, 0.002, True
    rim = outline[:, 2]
    rim = rim[rim > 0.6 * highest]
    if rim.size < config.least_points:
        return highest, config.top_m, False
    edge = _mode(rim, 2.0 * pitch)
    near = rim[np.abs(rim - edge) <= 2.0 * pitch]
    spread = float(near.std()) / math.sqrt(max(near.size / config.alike, 1.0))
    return float(near.mean()), math.hypot(spread, 0.3 * pitch), False


def _mode(values: Float[np.ndarray, "n"], half: float) -> float:
    """Where most values lie within a window."""
    ordered = np.sort(values)
    if ordered.size == 0:
        return 0.0
    count = np.searchsorted(ordered, ordered + 2.0 * half, side="right") - np.arange(ordered.size)
    first = int(np.argmax(count))
    return float(np.median(ordered[first : first + count[first]]))


@dataclass(frozen=True, eq=False)
class _Sides:
    """Heading, the four sides in axes so turned (x low, x high, y low, y high), deviations, what is known."""

    yaw: float
    at: Float[np.ndarray, "4"]
    sigma: Float[np.ndarray, "4"]
    known: Bool[np.ndarray, "4"]
    by_face: Bool[np.ndarray, "4"]


def _heading(plan: Float[np.ndarray, "n 2"]) -> float:
    """First guess: the heading whose rectangle has the most points close to its sides."""
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
    """Plan coordinates times this are those in axes turned by yaw."""
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([[c, -s], [s, c]])


def _sides(ends: Points3, faces: Float[np.ndarray, "m 3"], config: CuboidConfig) -> _Sides:
    """Heading and sides by least squares: faces lie on them, and so do all points of the outline."""
    plan = np.concatenate([ends[:, :2], faces[:, :2]])
    is_face = np.arange(len(plan)) >= len(ends)
    yaw = _heading(plan)
    turned = plan @ _axes(yaw)
    low, high = np.percentile(turned, (2.0, 98.0), axis=0)
    at = np.array([low[0], high[0], low[1], high[1]])
    sigma, known, by_face = np.full(4, np.inf), np.zeros(4, bool), np.zeros(4, bool)
    for gate in config.gates_m:
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
            by_face[side] = int(face.sum()) >= 3 * config.least_points
            used = face if by_face[side] else near & ~is_face
            least = config.least_points if by_face[side] else config.least_share * len(ends)
            known[side] = int(used.sum()) >= max(config.least_points, least)
            hessian_count[side] = used.sum()
            if not known[side]:
                continue
            # turning the axes by d moves a point by +along d in x, -along d in y
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
            sigma = 0.01 / np.sqrt(np.maximum(hessian_count / config.alike, 1e-3))
    return _Sides(yaw, at, sigma, known, by_face)


def _cuboid(
    sides: _Sides,
    top: tuple[float, float, bool],
    cut: bool,
    reach: float,
    pitch: float,
    floor: Plane,
    config: CuboidConfig,
) -> Cuboid | None:
    size = np.maximum(sides.at[1::2] - sides.at[::2], 0.0)
    if not np.any(size > config.thin_m):
        return None
    own = np.where(sides.by_face, 0.0, 0.5 * pitch)
    sigmas = np.hypot(sides.sigma, own)
    spread = np.hypot(sigmas[::2], sigmas[1::2])
    spread = np.hypot(spread, config.range_share * np.maximum(reach, size))
    seen = sides.known[::2] & sides.known[1::2] & (size > config.thin_m)
    middle = _axes(sides.yaw) @ (0.5 * (sides.at[1::2] + sides.at[::2]))
    long = int(np.argmax(size))
    heading = sides.yaw + (math.pi / 2.0 if long == 1 else 0.0)
    half = 0.5 * heading
    T_body_box = Pose3(
        (float(middle[0]), float(middle[1]), 0.0), (0.0, 0.0, math.sin(half), math.cos(half))
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
        math.hypot(math.hypot(top[1], sigma_floor), config.range_share * reach),
        bool(seen[long]),
        bool(seen[1 - long]),
        cut,
        top[2],
    )
