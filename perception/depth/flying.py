"""Flying pixels: false depth at the edges of objects.

A pixel on an edge mixes light from the object and from behind it. Its depth lies in between, where there is no surface:
between neighbours on opposite sides that are far apart, and away from both. The band of such pixels is one or two wide.
A surface at grazing incidence looks similar, so the jump must exceed that of any usable floor.

A depth image that was filtered across the edge, as by cameras with dense stereo, has a ramp there, several pixels wide.
Inverse depth of a plane is linear in the image, however it slants; that of a ramp is flat beyond both ends.

Source: ours.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float32

from ..primitives.camera import Camera
from ..primitives.frame import Depth
from . import _flying_kernels
from .points import Points

GRAZE_DEG = 3.0
"""Ours: surfaces seen at a smaller angle count as edges; a camera 0.4 m high sees the floor at 3 m at 7.6 deg."""
OFF_SIGMAS = 3.0  # ours: distance of a flying pixel from both of its neighbours
RAMP_DEG = 8.0  # ours: the sides of things are seen at larger angles than the ramp at their edge
RAMP_PX = (4, 8)
"""Ours: half widths of ramps. That of a Gaussian of s px has an even middle of 2 s; these find s from 1.5 to 6 px."""
RAMP_SIGMAS = 6.0  # ours: distance of the middle of a ramp from both ends; more than of one pixel, as noise has more chances
OWN_DEG = 10.0  # ours: a surface seen at this angle has rows so far apart that its last one is away from both


def flying(
    depth: Float32[np.ndarray, "h w"], sigma_m: Float32[np.ndarray, "h w"], camera: Camera
) -> Bool[np.ndarray, "h w"]:
    """Pixels between two surfaces that are far apart, and away from both, and those of ramps between them.

    Args:
        depth: Depth or range, m; NaN without.
        sigma_m: Its standard deviation.
        camera: Of the image.
    """
    found = np.zeros(depth.shape, np.bool_)
    steep = 1.0 / math.tan(math.radians(GRAZE_DEG))
    own = 1.0 / (math.tan(math.radians(OWN_DEG)) * steep)
    off = np.float32(OFF_SIGMAS) * sigma_m
    _flying_kernels.between(depth, off, steep / camera.fx, steep / camera.fy, own, found)
    with np.errstate(divide="ignore", over="ignore"):  # of depth that cannot be
        inverse = np.float32(1.0) / depth
    ramp = 1.0 / math.tan(math.radians(RAMP_DEG))
    off = np.float32(RAMP_SIGMAS) * sigma_m
    for reach in RAMP_PX:
        _flying_kernels.ramps(inverse, off, reach, ramp / camera.fx, ramp / camera.fy, found)
    return found


def without_flying(points: Points, depth: Depth) -> Points:
    """Points of a depth image that are not of flying pixels.

    The search for the floor and odometry use all points: of a small image the test takes true edges, too.
    """
    return points.of(~flying(depth.z, depth.sigma, depth.camera).ravel()[points.pixels])


def without_flying_pixels(depth: Depth) -> Depth:
    """A depth image with NaN at its flying pixels."""
    off = flying(depth.z, depth.sigma, depth.camera)
    return replace(depth, z=np.where(off, np.float32(np.nan), depth.z))
