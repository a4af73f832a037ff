"""How far, how wide and how high the things in a panorama are, each with its deviation.

The floor and what is above the robot are taken away; what remains is cut into level sets by forward
distance, labelled and put together to things. Each thing's outline gives its distance and where it ends;
the rotations of the views give how sure that is: an error that both edges share moves a thing and leaves
its width, so widths are surer than azimuths.

Source: seed 004, section 2.3, eq. (13) to (20); angles in place of pixel counts, edges finer than a pixel
and all deviations are ours.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float, Float32, Int, Int32
from scipy.ndimage import median_filter

from perception.primitives.errors import ConfigError
from perception.primitives.plane import Plane

from . import literal_formulas
from .adjustment import Placed
from .contours import ContourConfig, fronts
from .level_sets import LevelConfig, forward_distance, label, levels, merged
from .obstacles import PanoramaObstacle, Surroundings, gaps_between
from .rendering import Drawing
from .silhouettes import LabelledView, SilhouetteConfig, edge_crossings, fuse_edge, label_view
from .stitching import Panorama
from .views import View

LEVEL_FLOOR = Plane(np.array([0.0, 0.0, 1.0]), 0.0)


@dataclass(frozen=True)
class SizeConfig:
    """What counts as a thing, and what all of its pixels are wrong by."""

    levels: LevelConfig = field(default_factory=LevelConfig)
    contour: ContourConfig = field(default_factory=ContourConfig)
    silhouettes: SilhouetteConfig = field(default_factory=SilhouetteConfig)
    literal: bool = False  # distance, width, height and gaps by the printed formulas, see `printed`
    floor_m: float = 0.03  # spec of 004: lower is floor
    floor_sigmas: float = (
        3.0  # ours: or lower than this many deviations, where the views' tilt is unsure
    )
    farthest_range_m: float = (
        3.0  # ours: along the floor; walls far to the side are in nobody's way
    )
    widest_deg: float = 85.0  # ours: further aside nothing lies ahead; nine views reach 82 deg
    top_m: float = 0.7  # spec of 004: higher is nothing to walk into
    least_px: int = 60  # spec of 004: things of fewer pixels are noise
    reach_px: int = 2  # spec of 004: parts within 2 px hang together
    smooth_columns: int = 5  # ours: 1.25 deg: a nearest part is no narrower
    nearest_m: float = 0.006  # ours: columns so near to the nearest one are its face
    face_sigmas: float = 2.0  # ours: a face turned by so many deviations of the yaw is one across
    range_sigma_m: float = 0.003  # ours: what all pixels of a range camera share, calibrated
    turn_sigma_deg: float = (
        0.08  # ours: what two views laid upon each other are turned by in common
    )
    rim_deg: float = 1.0  # ours: mixed pixels of two views, side by side, are no wider
    scrap_share: float = 0.1  # ours: of the pixels of the thing that a scrap belongs to
    rim_columns: int = 4  # ours: drawing moves edges by up to so many columns of the outline

    def __post_init__(self) -> None:
        if not 0.0 < self.floor_m < self.top_m:
            raise ConfigError(
                f"sizes: floor_m={self.floor_m} must lie between 0 and top_m={self.top_m}"
            )
        if not 0.0 < self.widest_deg < 90.0:
            raise ConfigError(f"sizes: widest_deg={self.widest_deg} must lie between 0 and 90")
        if self.least_px < 1 or self.reach_px < 1 or self.smooth_columns < 1:
            raise ConfigError("sizes: least_px, reach_px and smooth_columns must be at least 1")


def surroundings(
    panorama: Panorama,
    views: Sequence[View],
    floor: Plane = LEVEL_FLOOR,
    config: SizeConfig | None = None,
) -> Surroundings:
    """Obstacles and gaps of a panorama, from left to right.

    Args:
        panorama: Finished; one without a drawing shows nothing.
        views: Those it was made of.
        floor: In the base frame; the default is what the feet stand on.
        config: What counts.
    """
    config = config or SizeConfig()
    drawing, placed = panorama.drawing, panorama.placed
    if drawing is None:
        return Surroundings((), ())
    forward, labels = label_obstacles(drawing, placed, floor, config)
    heights = config.floor_m, config.top_m
    seen = [
        label_view(
            view, place.T_base_camera, k, drawing, labels, floor, heights, config.silhouettes
        )
        for k, (view, place) in enumerate(zip(views, placed, strict=True))
        if place is not None
    ]
    scene = _Scene(drawing, forward, labels, placed, seen, floor)
    count = int(labels.max(initial=0))
    measured = (_measured(scene, number, config) for number in range(1, count + 1))
    found = [one for one in measured if one is not None]
    found = [one for one in found if not any(_is_rim(one, other, config) for other in found)]
    obstacles = tuple(sorted(found, key=lambda one: -one.bearing_rad))
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
    """The same thing measured by counting its pixels, as many as the camera's own grid has there."""
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
    """Forward distance of every pixel and which thing it belongs to.

    The same arguments give the same numbers to the same things: all who speak of labels take them from here.

    Args:
        drawing: The panorama.
        placed: The views' poses; where their tilt is unsure more counts as floor.
        floor: In the base frame.
        config: What counts.

    Returns:
        Forward distance from the base's origin, m, NaN where none is known or too far aside; labels from 1, 0 for
        floor, air, what is too far or too high.

    Source: seed 004, eq. (13) and (14).
    """
    forward_m = forward_distance(drawing.range_m, drawing.sphere) + np.float32(drawing.centre[0])
    across = drawing.sphere.left_rad + np.arange(drawing.sphere.width) / drawing.sphere.px_per_rad
    forward_m[:, np.abs(across) > math.radians(config.widest_deg)] = np.nan
    points = drawing.centre + drawing.sphere.rays * drawing.range_m[..., None].astype(np.float64)
    height = floor.distance(points)
    tilt = np.array([_tilt_sigma(place) for place in placed] + [0.0])[drawing.view]
    band = np.maximum(config.floor_m, config.floor_sigmas * tilt * drawing.range_m)
    with np.errstate(invalid="ignore"):
        standing = (height >= band) & (height <= config.top_m) & (forward_m > 0.0)
        standing &= np.hypot(points[..., 0], points[..., 1]) <= config.farthest_range_m
    slices = levels(np.where(standing, forward_m, np.float32(np.nan)), config.levels)
    step = config.levels.farthest_m / config.levels.count
    return forward_m, merged(label(slices), forward_m, config.reach_px, step, config.least_px)


def _tilt_sigma(place: Placed | None) -> float:
    """Deviation of a view's tilt about its own horizontal axis, rad."""
    return 0.0 if place is None else math.sqrt(max(float(place.covariance[0, 0]), 0.0))


@dataclass(frozen=True, eq=False)
class _Scene:
    """All that is known: the drawing with its things, and the views with theirs."""

    drawing: Drawing
    forward_m: Float32[np.ndarray, "h w"]
    labels: Int32[np.ndarray, "h w"]
    placed: Sequence[Placed | None]
    seen: Sequence[LabelledView]
    floor: Plane


def _measured(scene: _Scene, number: int, config: SizeConfig) -> PanoramaObstacle | None:
    """One thing; None if no column has a front or no view an edge of it."""
    mask = scene.labels == number
    front, front_sigma = fronts(scene.forward_m, scene.drawing.sigma_m, mask, config.contour)
    known = np.flatnonzero(np.isfinite(front))
    left, right, top = (
        fuse_edge(
            [
                c
                for c in (
                    edge_crossings(s, number, side, scene.floor, config.silhouettes)
                    for s in scene.seen
                )
                if c is not None
            ],
            config.silhouettes,
        )
        for side in ("left", "right", "top")
    )
    if known.size == 0 or left is None or right is None or top is None:
        return None
    smooth = median_filter(front[known], config.smooth_columns, mode="mirror")
    distance, sigma_distance = _nearest(scene, known, smooth, front_sigma[known], left.view, config)
    y_left, y_right = left.point[1], right.point[1]
    inside = _corners(scene, known, smooth, config.rim_columns)
    if inside is not None:
        y_left, y_right = max(y_left, inside[0]), min(y_right, inside[1])
    width = max(y_left - y_right, 0.0)
    turn = _between(scene.placed, left.view, right.view, math.radians(config.turn_sigma_deg))
    variance = (turn * distance) ** 2 + (width / distance * sigma_distance) ** 2
    for end in (left, right):
        variance += (end.sigma * (end.point[0] ** 2 + end.point[1] ** 2) / end.point[0]) ** 2
    reach = math.hypot(*top.point[:2])
    height_sigma = math.hypot(
        top.sigma, reach * _tilt_sigma(scene.placed[top.view]), config.range_sigma_m
    )
    slices = levels(np.where(mask, scene.forward_m, np.float32(np.nan)), config.levels)[mask]
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
        cut_top=not top.own or top.value > config.top_m - 0.02,
    )


def _nearest(
    scene: _Scene,
    known: Int[np.ndarray, "n"],
    smooth: Float[np.ndarray, "n"],
    sigma: Float[np.ndarray, "n"],
    view: int,
    config: SizeConfig,
) -> tuple[float, float]:
    """Forward distance of the nearest face and its deviation, m.

    A wide face across the way, seen under a yaw that is a little wrong, seems to come nearer at one end: what
    the yaw's deviation explains is the same face, and all of it is averaged.
    """
    aside = _aside(scene, known, smooth)
    yaw = _yaw_sigma(scene.placed, view)
    first = int(np.argmin(smooth))
    turned = config.face_sigmas * yaw * np.abs(aside - aside[first])
    face = smooth <= smooth[first] + config.nearest_m + turned
    weight = sigma[face] ** -2.0
    spread = yaw * float(np.std(aside[face]))
    own = 1.0 / math.sqrt(float(weight.sum()))
    return float(weight @ smooth[face] / weight.sum()), math.hypot(
        config.range_sigma_m, own, spread
    )


def _aside(
    scene: _Scene, known: Int[np.ndarray, "n"], smooth: Float[np.ndarray, "n"]
) -> Float[np.ndarray, "n"]:
    """y of the front in each column, base frame, m."""
    sphere, centre = scene.drawing.sphere, scene.drawing.centre
    theta = sphere.left_rad + known / sphere.px_per_rad
    return np.asarray(centre[1] - (smooth - centre[0]) * np.tan(theta))


def _is_rim(one: PanoramaObstacle, other: PanoramaObstacle, config: SizeConfig) -> bool:
    """Whether one is but the other's rim, a narrow strip beside and behind it.

    Mixed pixels make strips of a few columns, and so does a side seen at a grazing angle, which leaps from one
    level over the next with every pixel.
    """
    rim = math.radians(config.rim_deg)
    span = one.left_rad - one.right_rad
    touches = other.left_rad > one.right_rad - rim and other.right_rad < one.left_rad + rim
    behind = other.distance_m < one.distance_m + config.nearest_m
    scrap = span < 3.0 * rim and one.pixels < config.scrap_share * other.pixels
    return one is not other and touches and behind and (span < rim or scrap)


def _corners(
    scene: _Scene,
    known: Int[np.ndarray, "n"],
    smooth: Float[np.ndarray, "n"],
    rim: int,
) -> tuple[float, float] | None:
    """Greatest and least y of the outline between its edges: a corner may stand out further."""
    if known.size <= 2 * rim:
        return None
    aside = _aside(scene, known, smooth)[rim:-rim]
    return float(aside.max()), float(aside.min())


def _yaw_sigma(placed: Sequence[Placed | None], view: int) -> float:
    """Deviation of a view's turn about the vertical, rad."""
    place = placed[view]
    if place is None or place.yaws is None:
        return 0.0
    return math.sqrt(max(float(place.yaws[view]), 0.0))


def _between(placed: Sequence[Placed | None], one: int, other: int, least_rad: float) -> float:
    """Deviation of the turn between two views, rad."""
    a, b = placed[one], placed[other]
    if one == other or a is None or b is None or a.yaws is None or b.yaws is None:
        return 0.0
    variance = float(a.yaws[one] + b.yaws[other] - 2.0 * a.yaws[other])
    return math.sqrt(max(variance, 0.0) + least_rad**2)
