"""Rendering: range, sigma and time stamp at every pixel of the sphere, from the views and their poses.

The sphere has one centre and the cameras are near it: each view is drawn as seen from the centre, by
intersecting each ray with its depth. If views disagree, the nearest range occludes the others. Ranges up to
3 cm behind it (or four standard deviations, at long range) belong to the same surface and are averaged with
inverse variance. A panorama of more than a turn shows each direction once: its ends, straight behind, meet.

Source: Kang 2013 (seed 004), section 4 (vi), as reconstructed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Float32, Int

from perception.primitives.pose import Pose3

from .. import open3d_objects
from ..pinhole import pinhole_of
from . import _kernels
from .adjustment import Placed
from .sphere import Sphere, direction, window_of_view
from .views import View

RIM_PX = 4  # ours: parallax extends a view seen from the centre by less than this
SAME_M = 0.03  # seed 004 as specified: ranges this close are one surface
PX_PER_DEG = 4.0  # seed 004: 176 px over 44 deg


@dataclass(frozen=True, eq=False)
class Drawing:
    """A panorama as images over a sphere.

    Args:
        sphere: Angles of the pixels.
        centre: Centre of the sphere, base frame, m.
        range_m: Range from the centre, NaN where unknown.
        sigma_m: Standard deviation of the range by depth noise.
        stamp_s: Time at which each pixel was last seen, s; NaN if never.
        view: Index of the view that saw it last; -1 if none did.
    """

    sphere: Sphere
    centre: Float[np.ndarray, "3"]
    range_m: Float32[np.ndarray, "h w"]
    sigma_m: Float32[np.ndarray, "h w"]
    stamp_s: Float[np.ndarray, "h w"]
    view: Int[np.ndarray, "h w"]

    def to_open3d(self) -> Any:
        """The panorama as an `open3d.t.geometry.PointCloud`, base frame, m, with sigma (m), stamp (s) and view."""
        return open3d_objects.point_cloud(self.points()[0], None, self.attributes())

    def attributes(self) -> dict[str, np.ndarray]:
        """Of each of the `points`: sigma along its ray (m), stamp (s) and index of the view."""
        seen = np.isfinite(self.range_m)
        return {
            "sigma": self.sigma_m[seen],
            "stamp": self.stamp_s[seen],
            "view": self.view[seen].astype(np.int32),
        }

    def points(self) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n"]]:
        """The panorama as a cloud: points in the base frame, m, and sigma along their rays, m."""
        row, column = np.nonzero(np.isfinite(self.range_m))
        rays = direction(*self.sphere.angles(column.astype(float), row.astype(float)))
        xyz = self.centre + rays * self.range_m[row, column, None]
        return xyz, self.sigma_m[row, column].astype(np.float64)


def render(
    views: Sequence[View], placed: Sequence[Placed | None], px_per_deg: float = PX_PER_DEG
) -> Drawing | None:
    """Draw all placed views, whose images must be free of lens distortion; None without one."""
    known = [(view, place) for view, place in zip(views, placed, strict=True) if place is not None]
    if not known:
        return None
    numbers = np.array([k for k, place in enumerate(placed) if place is not None])
    px_per_rad = float(np.degrees(px_per_deg))
    centre = np.mean([place.T_base_camera.position for _, place in known], axis=0)
    drawn = [draw_view(view, place.T_base_camera, px_per_rad, centre) for view, place in known]
    sphere = _enclosing([part for _, _, part in drawn], px_per_rad)
    shape = (len(known), sphere.height, sphere.width)
    ranges, sigmas = np.full(shape, np.nan, np.float32), np.full(shape, np.nan, np.float32)
    for number, (view_range, view_sigma, part) in enumerate(drawn):
        left, top = corner(part, sphere)
        rows = slice(top, top + part.height)
        columns = (left + np.arange(part.width)) % _turn(px_per_rad)
        ranges[number][rows, columns] = view_range
        sigmas[number][rows, columns] = view_sigma
    range_m, sigma_m = np.empty(shape[1:], np.float32), np.empty(shape[1:], np.float32)
    newest = np.empty(shape[1:], np.int64)
    order = np.argsort([view.stamp_s for view, _ in known], kind="stable")
    _kernels.fuse(ranges[order], sigmas[order], SAME_M, range_m, sigma_m, newest)
    stamps = np.array([known[i][0].stamp_s for i in order])
    stamp = np.where(newest >= 0, stamps[newest], np.nan)
    shown = np.where(newest >= 0, numbers[order][newest], -1)
    return Drawing(sphere, centre, range_m, sigma_m, stamp, shown)


def _turn(px_per_rad: float) -> int:
    """Columns of a whole turn."""
    return round(2.0 * math.pi * px_per_rad)


def _enclosing(windows: Sequence[Sphere], px_per_rad: float) -> Sphere:
    """The smallest window that contains windows of one grid; of more than a turn the one from behind to behind."""
    left = min(w.left_rad for w in windows)
    top = max(w.top_rad for w in windows)
    right = max(w.left_rad + (w.width - 1) / px_per_rad for w in windows)
    bottom = min(w.top_rad - (w.height - 1) / px_per_rad for w in windows)
    width, turn = round((right - left) * px_per_rad) + 1, _turn(px_per_rad)
    if width > turn:
        width, left = turn, -(turn // 2) / px_per_rad
    return Sphere(
        width,
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
    """Range from the centre and its sigma, m, over the part of the sphere that one view covers."""
    camera = view.depth.camera
    part = window_of_view(camera, T_base_camera.rotation, px_per_rad)
    part = Sphere(
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
        pinhole_of(camera),
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
