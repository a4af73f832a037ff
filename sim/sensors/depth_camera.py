"""Active stereo camera, such as a RealSense D435: depth by matching two infrared pictures of a projected pattern.

It measures disparity, in whole steps of a fraction of a pixel, so its noise grows with the square of depth. Each
disparity is that of a block of pixels: noise is alike within a block, and a block on an outline, where disparity jumps,
shows the nearer of its surfaces. What only the left imager sees, beside every near object, has no depth, and neither has what
is nearer than the search goes. Each camera keeps the error of disparity and of scale that its calibration has left; they are
drawn within what the stack claims of a calibrated camera, so the NEES of a walk tests how claims are carried on, not whether a
D435 keeps to them.

Sources: Grunnet-Jepsen, Sweetser, Woodfill, Intel 2018 (subpixel error .08 px and less, steps of 1/32 px, baseline 50 mm);
data sheet of the D400 series (nearest depth .28 m at 848 x 480; depth in mm); what calibration leaves: ours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32

from perception.primitives.camera import Camera
from perception.primitives.errors import ConfigError
from perception.primitives.pose import Pose3

from ..ranges import MOST_PX, check_ranges
from ..rendering.surfaces import RangeSource, unit_rays

FINER = 2  # the pictures are matched at twice the size of the depth, which is decimated
STEP_PX = 1.0 / 32.0
BLOCK_PX = 1.5  # ours: standard deviation of the blur that makes the noise of a block alike
JUMP_PX = 1.0  # ours: surfaces that differ by less within a block are matched as one
UNIT_M = 0.001
LIMIT_DEG = 80.0  # ours: a surface met at a flatter angle gives no disparity


@dataclass(frozen=True)
class DepthCameraConfig:
    """Model of a D435 whose depth is decimated by two.

    Args:
        noise_px: Standard deviation of disparity, in pixels of the matched pictures, as `bend_px`.
        bend_px: Standard deviation of the lasting error of disparity, for each of its terms over the picture.
        scale_share: Standard deviation of the lasting error of scale.
    """

    width: int = 424
    height: int = 240
    across_deg: float = 87.0
    down_deg: float = 58.0
    baseline_m: float = 0.05
    nearest_m: float = 0.28
    noise_px: float = 0.08
    bend_px: float = 0.012
    scale_share: float = 0.0004

    def __post_init__(self) -> None:
        for name in ("across_deg", "down_deg"):
            if not 0.0 < getattr(self, name) < 170.0:
                raise ConfigError(
                    f"depth camera: {name}={getattr(self, name)} must lie in (0, 170)"
                )
        check_ranges(
            "depth camera",
            self,
            width=(4.0, MOST_PX),
            height=(4.0, MOST_PX),
            baseline_m=(0.001, 1.0),
            nearest_m=(0.0, 10.0),
            noise_px=(0.0, 10.0),
            bend_px=(0.0, 10.0),
            scale_share=(0.0, 1.0),
        )

    @property
    def camera(self) -> Camera:
        """Intrinsics of the left imager, whose pixels the depth has."""
        return Camera.from_view(
            self.width, self.height, math.radians(self.across_deg), math.radians(self.down_deg)
        )


class DepthCamera:
    """A camera with its own lasting errors."""

    def __init__(self, config: DepthCameraConfig, rng: np.random.Generator) -> None:
        self.config = config
        self.camera = config.camera
        self._rng = rng
        u, v = (self.camera.rays[..., k] / self.camera.rays[..., 0].max() for k in (0, 1))
        shapes = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v])
        self._bend_px = np.tensordot(config.bend_px * rng.normal(size=6), shapes, 1)
        self._scale = 1.0 + config.scale_share * float(rng.normal())
        blurred = cv2.getGaussianKernel(4 * math.ceil(BLOCK_PX) + 1, BLOCK_PX)
        self._noise_px = config.noise_px / float(np.sum(blurred**2))  # before the blur

    def measure(self, source: RangeSource, T_world_camera: Pose3) -> Float32[np.ndarray, "h w"]:
        """Depth along the optical axis, m; NaN where there is none."""
        config = self.config
        hits = source.look(self.camera, T_world_camera)
        _, length = unit_rays(self.camera)
        shape = (config.height, config.width)
        lit = hits.cosine > math.cos(math.radians(LIMIT_DEG))
        z = (hits.distance_m / length).reshape(shape).astype(np.float64)
        pull = FINER * self.camera.fx * config.baseline_m
        exact = np.where(np.isfinite(z), pull / np.maximum(z, 1e-3), 0.0)
        seen = (exact > 0.0) & lit.reshape(shape) & ~_hidden(exact / FINER)
        nearer = cv2.dilate(exact, np.ones((3, 3), np.uint8))
        block = np.where(nearer - exact > JUMP_PX, nearer, exact)
        white = self._noise_px * self._rng.standard_normal(shape)
        size = 4 * math.ceil(BLOCK_PX) + 1
        noise = cv2.GaussianBlur(white, (size, size), BLOCK_PX)
        disparity = np.rint((block + self._bend_px + noise) / STEP_PX) * STEP_PX
        seen &= (disparity > 0.0) & (disparity <= pull / config.nearest_m)
        depth = self._scale * pull / np.where(seen, disparity, 1.0)
        return np.where(seen, np.rint(depth / UNIT_M) * UNIT_M, np.nan).astype(np.float32)


def _hidden(disparity: Float[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """What the right imager does not see: pixels further right lie before it, or it is out of its picture."""
    columns = np.arange(disparity.shape[1]) - disparity
    first = np.minimum.accumulate(columns[:, ::-1], axis=1)[
        :, ::-1
    ]  # of this pixel and those right of it
    return np.asarray((columns > first + 0.5) | (columns < 0.0))
