"""Pinhole intrinsics in a form that compiled kernels accept."""

from __future__ import annotations

from typing import NamedTuple

from perception.primitives.camera import Camera


class Pinhole(NamedTuple):
    """Focal lengths and principal point, px."""

    fx: float
    fy: float
    cx: float
    cy: float


def pinhole_of(camera: Camera) -> Pinhole:
    """The intrinsics of a camera, without its distortion."""
    return Pinhole(camera.fx, camera.fy, camera.cx, camera.cy)
