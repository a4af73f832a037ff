"""Drawing the placed views: range, its sigma and its age at every pixel of the sphere.

The sphere's centre is one place, the cameras are near it: each view is drawn as seen from the centre, by
looking up where a ray meets its depth. Where views disagree the nearest range wins, as it hides the rest;
what lies within 3 cm behind it (or four of its deviations, far away) is the same surface and is averaged by
its variance.

Source: seed 004, section 4 (vi), as reconstructed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Int

from perception.primitives.errors import ConfigError
from perception.primitives.pose import Pose3

from . import _kernels
from .adjustment import Placed
from .sphere import Sphere, direction, window_of_view
from .views import View

RIM_PX = 4


@dataclass(frozen=True)
class RenderConfig:
    """Grain of the panorama, and what counts as one surface."""

    px_per_deg: float = 4.0  # seed 004: 176 px over 44 deg
    same_m: float = 0.03  # spec of 004: within 3 cm it is one surface

    def __post_init__(self) -> None:
        if not (self.px_per_deg > 0.0 and self.same_m > 0.0):
            raise ConfigError(
                f"render: px_per_deg={self.px_per_deg} and same_m={self.same_m} must be positive"
            )


@dataclass(frozen=True, eq=False)
class Drawing:
    """A panorama as images over a sphere.

    Args:
        sphere: Angles of the pixels.
        centre: Of the sphere, base frame, m.
        range_m: From the centre, NaN where no view looks or none has depth.
        sigma_m: Deviation of it: noise of the views.
        stamp_s: When each pixel was last seen, s; NaN where it was not.
        view: Which view saw it last, as they were given; -1 where none did.
    """

    sphere: Sphere
    centre: Float[np.ndarray, "3"]
    range_m: Float32[np.ndarray, "h w"]
    sigma_m: Float32[np.ndarray, "h w"]
    stamp_s: Float[np.ndarray, "h w"]
    view: Int[np.ndarray, "h w"]

    def points(self) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n"]]:
        """The panorama as a cloud: points in the base frame, m, and the deviation along their rays."""
        row, column = np.nonzero(np.isfinite(self.range_m))
        rays = direction(*self.sphere.angles(column.astype(float), row.astype(float)))
        xyz = self.centre + rays * self.range_m[row, column, None]
        return xyz, self.sigma_m[row, column].astype(np.float64)


def render(
    views: Sequence[View], placed: Sequence[Placed | None], config: RenderConfig | None = None
) -> Drawing | None:
    """Draw all views that are placed; None if there is none.

    A view's drawing is where its own directions fall; lens distortion must have been removed.
    """
    config = config or RenderConfig()
    known = [(view, place) for view, place in zip(views, placed, strict=True) if place is not None]
    if not known:
        return None
    numbers = np.array([k for k, place in enumerate(placed) if place is not None])
    px_per_rad = float(np.degrees(config.px_per_deg))
    centre = np.mean([place.T_base_camera.position for _, place in known], axis=0)
    drawn = [draw_view(view, place.T_base_camera, px_per_rad, centre) for view, place in known]
    sphere = _around([part for _, _, part in drawn], px_per_rad)
    shape = (len(known), sphere.height, sphere.width)
    ranges, sigmas = np.full(shape, np.nan, np.float32), np.full(shape, np.nan, np.float32)
    for number, (view_range, view_sigma, part) in enumerate(drawn):
        left, top = corner(part, sphere)
        rows, columns = slice(top, top + part.height), slice(left, left + part.width)
        ranges[number, rows, columns] = view_range
        sigmas[number, rows, columns] = view_sigma
    range_m, sigma_m = np.empty(shape[1:], np.float32), np.empty(shape[1:], np.float32)
    newest = np.empty(shape[1:], np.int64)
    order = np.argsort([view.stamp_s for view, _ in known], kind="stable")
    _kernels.fuse(ranges[order], sigmas[order], config.same_m, range_m, sigma_m, newest)
    stamps = np.array([known[i][0].stamp_s for i in order])
    stamp = np.where(newest >= 0, stamps[newest], np.nan)
    shown = np.where(newest >= 0, numbers[order][newest], -1)
    return Drawing(sphere, centre, range_m, sigma_m, stamp, shown)


def _around(windows: Sequence[Sphere], px_per_rad: float) -> Sphere:
    """The window round all windows of one grid."""
    left = min(w.left_rad for w in windows)
    top = max(w.top_rad for w in windows)
    right = max(w.left_rad + (w.width - 1) / px_per_rad for w in windows)
    bottom = min(w.top_rad - (w.height - 1) / px_per_rad for w in windows)
    return Sphere(
        round((right - left) * px_per_rad) + 1,
        round((top - bottom) * px_per_rad) + 1,
        px_per_rad,
        left,
        top,
    )


def draw_view(
    view: View,
    T_base_camera: Pose3,
    px_per_rad: float,
    centre: Float[np.ndarray, "3"],
) -> tuple[Float32[np.ndarray, "a b"], Float32[np.ndarray, "a b"], Sphere]:
    """Range from the centre and its deviation, m, over the part of the sphere that one view covers."""
    camera = view.depth.camera
    part = window_of_view(camera, T_base_camera.rotation, px_per_rad)
    part = Sphere(  # a rim, as seen from the centre a view may reach a little further
        part.width + 2 * RIM_PX,
        part.height + 2 * RIM_PX,
        px_per_rad,
        part.left_rad - RIM_PX / px_per_rad,
        part.top_rad + RIM_PX / px_per_rad,
    )
    range_m = np.full((part.height, part.width), np.nan, np.float32)
    sigma_m = np.full_like(range_m, np.nan)
    _kernels.draw(
        part.rays,
        view.depth.z,
        view.depth.sigma,
        np.ascontiguousarray(T_base_camera.rotation.T),
        T_base_camera.position,
        np.array([camera.fx, camera.fy, camera.cx, camera.cy]),
        centre,
        range_m,
        sigma_m,
    )
    return range_m, sigma_m, part


def corner(part: Sphere, sphere: Sphere) -> tuple[int, int]:
    """(x, y) of a part's first pixel in a sphere of the same grid."""
    return (
        round((part.left_rad - sphere.left_rad) * sphere.px_per_rad),
        round((sphere.top_rad - part.top_rad) * sphere.px_per_rad),
    )
