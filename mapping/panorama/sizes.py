"""Distance, width and height of the obstacles in a panorama, each with its standard deviation.

Floor and everything above the robot are removed. The rest is cut into level sets of forward distance, labelled
and merged to obstacles. The outline of an obstacle gives its distance and edges. The covariance of the views'
rotations gives their uncertainty: a rotation error common to both edges moves an obstacle and keeps its width,
so that widths are more certain than azimuths.

Source: Kang 2013 (seed 004), section 2.3, eq. (13) to (20); angles in place of pixel counts, subpixel edges
and all standard deviations are ours.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float, Float32, Int, Int32
from scipy.ndimage import median_filter

from perception.primitives.plane import Plane

from . import literal_formulas
from .adjustment import Placed
from .contours import fronts
from .hidden_corners import with_hidden_corners
from .level_sets import LevelConfig, forward_distance, label, levels, merge_parts
from .obstacles import PanoramaObstacle, Surroundings, gaps_between
from .rendering import Drawing
from .silhouettes import LabelledView, edge_crossings, fuse_edge, label_view
from .stitching import Panorama
from .views import View

LEVEL_FLOOR = Plane(np.array([0.0, 0.0, 1.0]), 0.0)


FLOOR_M = 0.03  # seed 004 as specified: lower points are floor
FLOOR_SIGMAS = 3.0  # ours: or lower than this many standard deviations of a view's tilt
FARTHEST_RANGE_M = 3.0  # ours: along the floor; walls far to the side block nothing
WIDEST_DEG = 85.0  # ours: azimuths beyond have no forward distance; nine views reach 82 deg
TOP_M = 0.7  # seed 004 as specified: higher points are no obstacle
LEAST_PX = 60  # seed 004 as specified: obstacles of fewer pixels are noise
REACH_PX = 2  # seed 004 as specified: parts within 2 px are connected
SMOOTH_COLUMNS = 5  # ours: 1.25 deg; the nearest part is no narrower
NEAREST_M = 0.006  # ours: columns this close to the nearest one belong to its face
FACE_SIGMAS = 2.0  # ours: a face oblique by this many yaw sigmas is a perpendicular one
RANGE_SIGMA_M = 0.003  # ours: range error common to all pixels of a calibrated camera
TURN_SIGMA_RAD = math.radians(0.08)  # ours: common rotation error of two aligned views
RIM_RAD = math.radians(1.0)  # ours: widest strip of mixed pixels of two views
SCRAP_SHARE = 0.1  # ours: largest share of pixels of a fragment in those of its obstacle
RIM_COLUMNS = 4  # ours: columns by which drawing displaces an edge of the outline


@dataclass(frozen=True)
class SizeConfig:
    """How sizes are measured."""

    levels: LevelConfig = field(default_factory=LevelConfig)
    literal: bool = False  # apply the printed formulas, see `literal_formulas`; for comparison only


def surroundings(
    panorama: Panorama,
    views: Sequence[View],
    floor: Plane = LEVEL_FLOOR,
    config: SizeConfig | None = None,
) -> Surroundings:
    """Obstacles and gaps of a panorama, from left to right.

    Args:
        panorama: The panorama; one without a drawing has no obstacles.
        views: Its views.
        floor: In the base frame; the default is the plane z = 0.
        config: How sizes are measured.
    """
    config = config or SizeConfig()
    drawing, placed = panorama.drawing, panorama.placed
    if drawing is None:
        return Surroundings((), ())
    forward, labels = label_obstacles(drawing, placed, floor, config)
    views_with_labels = [
        label_view(view, place.T_base_camera, k, drawing, labels, floor, (FLOOR_M, TOP_M))
        for k, (view, place) in enumerate(zip(views, placed, strict=True))
        if place is not None
    ]
    scene = _Scene(drawing, forward, labels, placed, views_with_labels, floor)
    count = int(labels.max(initial=0))
    measured = (_measured(scene, number, config.levels) for number in range(1, count + 1))
    found = [one for one in measured if one is not None]
    found = [one for one in found if not any(_is_rim(one, other) for other in found)]
    found = sorted(found, key=lambda one: -one.bearing_rad)
    obstacles = with_hidden_corners(found, drawing, labels, floor)
    sphere = drawing.sphere
    ends = -sphere.left_rad, -(sphere.left_rad + (sphere.width - 1) / sphere.px_per_rad)
    gaps = gaps_between(obstacles, ends, config.levels.farthest_m)
    if config.literal:
        obstacles = tuple(_as_printed(scene, one) for one in obstacles)
        spans = [literal_formulas.ACROSS_PX_PER_RAD * (g.left_rad - g.right_rad) for g in gaps]
        gaps = tuple(
            replace(g, width_m=literal_formulas.width(g.distance_m, span))
            for g, span in zip(gaps, spans, strict=True)
        )
    return Surroundings(obstacles, gaps)


def _as_printed(scene: _Scene, one: PanoramaObstacle) -> PanoramaObstacle:
    """The same obstacle measured by counting pixels, converted to the camera's own resolution."""
    rows, columns = np.nonzero(scene.labels == one.label)
    reach = float(np.median(scene.drawing.range_m[rows, columns]))
    far = literal_formulas.distance(reach, one.bearing_rad)
    scale = scene.drawing.sphere.px_per_rad
    across = (int(np.ptp(columns)) + 1) * literal_formulas.ACROSS_PX_PER_RAD / scale
    down = (int(np.ptp(rows)) + 1) * literal_formulas.DOWN_PX_PER_RAD / scale
    return replace(
        one,
        distance_m=far,
        width_m=literal_formulas.width(far, across),
        height_m=literal_formulas.height(far, down),
    )


def label_obstacles(
    drawing: Drawing, placed: Sequence[Placed | None], floor: Plane, config: SizeConfig
) -> tuple[Float32[np.ndarray, "h w"], Int32[np.ndarray, "h w"]]:
    """Forward distance and obstacle label of every pixel.

    The labels are deterministic: the same arguments give the same label to the same obstacle.

    Args:
        drawing: The panorama.
        placed: Poses of the views; the tilt covariance widens the band of the floor.
        floor: In the base frame.
        config: How sizes are measured.

    Returns:
        Forward distance from the base's origin, m, NaN if unknown or beyond the widest azimuth; labels from
        1, 0 for floor, free space, and pixels too far or too high.

    Source: seed 004, eq. (13) and (14).
    """
    forward_m = forward_distance(drawing.range_m, drawing.sphere) + np.float32(drawing.centre[0])
    across = drawing.sphere.left_rad + np.arange(drawing.sphere.width) / drawing.sphere.px_per_rad
    forward_m[:, np.abs(across) > math.radians(WIDEST_DEG)] = np.nan
    points = drawing.centre + drawing.sphere.rays * drawing.range_m[..., None].astype(np.float64)
    height = floor.distance(points)
    tilt = np.array([_tilt_sigma(place) for place in placed] + [0.0])[drawing.view]
    band = np.maximum(FLOOR_M, FLOOR_SIGMAS * tilt * drawing.range_m)
    with np.errstate(invalid="ignore"):
        standing = (height >= band) & (height <= TOP_M) & (forward_m > 0.0)
        standing &= np.hypot(points[..., 0], points[..., 1]) <= FARTHEST_RANGE_M
    slices = levels(np.where(standing, forward_m, np.float32(np.nan)), config.levels)
    step = config.levels.farthest_m / config.levels.count
    return forward_m, merge_parts(label(slices), forward_m, REACH_PX, step, LEAST_PX)


def _tilt_sigma(place: Placed | None) -> float:
    """Standard deviation of a view's tilt about its own horizontal axis, rad."""
    return 0.0 if place is None else math.sqrt(max(float(place.covariance[0, 0]), 0.0))


@dataclass(frozen=True, eq=False)
class _Scene:
    """The panorama and its views with their labels."""

    drawing: Drawing
    forward_m: Float32[np.ndarray, "h w"]
    labels: Int32[np.ndarray, "h w"]
    placed: Sequence[Placed | None]
    views: Sequence[LabelledView]
    floor: Plane


def _measured(scene: _Scene, number: int, config: LevelConfig) -> PanoramaObstacle | None:
    """One obstacle; None if no column shows its front or no view an edge of it."""
    mask = scene.labels == number
    front, front_sigma = fronts(scene.forward_m, scene.drawing.sigma_m, mask)
    known = np.flatnonzero(np.isfinite(front))
    left, right, top = (
        fuse_edge(
            [
                found
                for view in scene.views
                if (found := edge_crossings(view, number, side, scene.floor)) is not None
            ]
        )
        for side in ("left", "right", "top")
    )
    if known.size == 0 or left is None or right is None or top is None:
        return None
    smooth = median_filter(front[known], SMOOTH_COLUMNS, mode="mirror")
    distance, sigma_distance = _nearest(scene, known, smooth, front_sigma[known], left.view)
    y_left, y_right = left.point[1], right.point[1]
    inside = _corners(scene, known, smooth, RIM_COLUMNS)
    if inside is not None:
        y_left, y_right = max(y_left, inside[0]), min(y_right, inside[1])
    width = max(y_left - y_right, 0.0)
    turn = _between(scene.placed, left.view, right.view, TURN_SIGMA_RAD)
    variance = (turn * distance) ** 2 + (width / distance * sigma_distance) ** 2
    for end, sign in ((left, 1.0), (right, -1.0)):
        x, y, _ = end.point
        # On the side turned to straight ahead, a corner may protrude that only the outline shows, to half a column.
        column = 0.5 / scene.drawing.sphere.px_per_rad if sign * y < 0.0 else 0.0
        variance += (math.hypot(end.sigma, column) * (x**2 + y**2) / x) ** 2
    reach = math.hypot(*top.point[:2])
    height_sigma = math.hypot(top.sigma, reach * _tilt_sigma(scene.placed[top.view]), RANGE_SIGMA_M)
    slices = levels(np.where(mask, scene.forward_m, np.float32(np.nan)), config)[mask]
    return PanoramaObstacle(
        left_rad=max(left.value, -right.value),
        right_rad=min(left.value, -right.value),
        distance_m=distance,
        width_m=width,
        height_m=top.value,
        sigma_left_rad=math.hypot(left.sigma, _yaw_sigma(scene.placed, left.view)),
        sigma_right_rad=math.hypot(right.sigma, _yaw_sigma(scene.placed, right.view)),
        sigma_distance_m=sigma_distance,
        sigma_width_m=math.sqrt(variance),
        sigma_height_m=height_sigma,
        left_edge_m=(left.point[0], y_left),
        right_edge_m=(right.point[0], y_right),
        label=number,
        levels=(int(slices[slices > 0].min()), int(slices.max())),
        pixels=int(mask.sum()),
        cut_left=not left.own,
        cut_right=not right.own,
        cut_top=not top.own or top.value > TOP_M - 0.02,
    )


def _nearest(
    scene: _Scene,
    known: Int[np.ndarray, "n"],
    smooth: Float[np.ndarray, "n"],
    sigma: Float[np.ndarray, "n"],
    view: int,
) -> tuple[float, float]:
    """Forward distance of the nearest face and its standard deviation, m.

    With a small yaw error, one end of a wide perpendicular face appears nearer. Columns within the yaw's
    standard deviation belong to the same face, and all of them are averaged.
    """
    lateral = _lateral(scene, known, smooth)
    yaw = _yaw_sigma(scene.placed, view)
    first = int(np.argmin(smooth))
    turned = FACE_SIGMAS * yaw * np.abs(lateral - lateral[first])
    face = smooth <= smooth[first] + NEAREST_M + turned
    weight = sigma[face] ** -2.0
    spread = yaw * float(np.std(lateral[face]))
    own = 1.0 / math.sqrt(float(weight.sum()))
    return float(weight @ smooth[face] / weight.sum()), math.hypot(RANGE_SIGMA_M, own, spread)


def _lateral(
    scene: _Scene, known: Int[np.ndarray, "n"], smooth: Float[np.ndarray, "n"]
) -> Float[np.ndarray, "n"]:
    """y of the front in each column, base frame, m."""
    sphere, centre = scene.drawing.sphere, scene.drawing.centre
    theta = sphere.left_rad + known / sphere.px_per_rad
    return np.asarray(centre[1] - (smooth - centre[0]) * np.tan(theta))


def _is_rim(one: PanoramaObstacle, other: PanoramaObstacle) -> bool:
    """Whether one obstacle is only the rim of another, a narrow strip beside and behind it.

    Mixed pixels form strips of a few columns, and so does a side seen at a grazing angle, which skips
    levels from pixel to pixel.
    """
    rim = RIM_RAD
    span = one.left_rad - one.right_rad
    touches = other.left_rad > one.right_rad - rim and other.right_rad < one.left_rad + rim
    behind = other.distance_m < one.distance_m + NEAREST_M
    scrap = span < 3.0 * rim and one.pixels < SCRAP_SHARE * other.pixels
    return one is not other and touches and behind and (span < rim or scrap)


def _corners(
    scene: _Scene,
    known: Int[np.ndarray, "n"],
    smooth: Float[np.ndarray, "n"],
    rim: int,
) -> tuple[float, float] | None:
    """Largest and smallest y of the outline between its edges: a corner may protrude."""
    if known.size <= 2 * rim:
        return None
    lateral = _lateral(scene, known, smooth)[rim:-rim]
    return float(lateral.max()), float(lateral.min())


def _yaw_sigma(placed: Sequence[Placed | None], view: int) -> float:
    """Standard deviation of a view's rotation about the vertical, rad."""
    place = placed[view]
    if place is None or place.yaws is None:
        return 0.0
    return math.sqrt(max(float(place.yaws[view]), 0.0))


def _between(placed: Sequence[Placed | None], one: int, other: int, least_rad: float) -> float:
    """Standard deviation of the relative rotation of two views about the vertical, rad."""
    a, b = placed[one], placed[other]
    if one == other or a is None or b is None or a.yaws is None or b.yaws is None:
        return 0.0
    variance = float(a.yaws[one] + b.yaws[other] - 2.0 * a.yaws[other])
    return math.sqrt(max(variance, 0.0) + least_rad**2)
