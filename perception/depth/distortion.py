"""Distortion of depth: the errors that all points of a view share, and that no residual shows.

Consumer depth bends. The relative error of depth is a smooth field over the image, of second order in the ray slopes,
and the same from frame to frame, so it does not average out. Its size has three parts: constant in m (time of flight),
a share of depth (focal length, baseline), and growing with depth (triangulation: an error of disparity).

Sources: Teichman, Miller and Thrun 2013, Herrera et al. 2012 (smooth distortion that grows with depth, structured
light); Boehm 2014 (18 sensors of that kind differ by centimetres); Sturm et al. 2012
(depth scales of three Kinects: 0 to 3.5 %); data sheets of the Intel D400 (2 % at 2 m) and of the Azure Kinect (11 mm
+ 0.1 %); the shape of second order ours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Float, Float32

from ..primitives import plugins
from ..primitives.camera import Camera
from ..primitives.errors import ConfigError
from ..primitives.settings import setting

MOST_BEND = (
    0.1  # ours: five times that of consumer sensors; even in a tall image depth stays positive
)
ORDERS = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))  # powers of the slopes, right and down


@dataclass(frozen=True)
class Distortion:
    """Standard deviation of the depth error common to all points of a view, at any place of the image.

    The parts are independent; each has a constant, a linear and a quadratic term over the image, which are equally
    large at the image's left and right edge.
    """

    offset_m: float = setting(
        0.0,
        "m",
        "common error of depth, the same at every depth",
        "SR-4000 10 mm; Azure Kinect 11 mm",
    )
    share: float = setting(
        0.0,
        "",
        "common error of depth as a share of depth",
        "Azure Kinect .1 %; three Kinects 0 to 3.5 %",
    )
    share_per_m: float = setting(
        0.0,
        "1/m",
        "the same per m of depth: an error of disparity",
        "D400 2 % at 2 m; Kinect .2 px",
    )
    noises: float = setting(
        0.0, "", "common error in standard deviations of noise", "stereo calibrations: .1 to .3 px"
    )

    def __post_init__(self) -> None:
        for name in ("offset_m", "share", "share_per_m", "noises"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise ConfigError(f"distortion: {name}={value} must not be negative, and finite")

    def parts(
        self, z: Float[np.ndarray, "n"], sigma: Float[np.ndarray, "n"]
    ) -> Float[np.ndarray, "n k"]:
        """Relative size of every part that is not zero at depths z with noise sigma, m."""
        kept = self._parts(z, sigma)
        return np.stack(kept, axis=1) if kept else np.zeros((len(z), 0))

    def size(
        self, z: Float[np.ndarray, "n"], sigma: Float[np.ndarray, "n"]
    ) -> Float[np.ndarray, "n"]:
        """Standard deviation of the relative error of depth at the image centre."""
        kept = self._parts(z, sigma)
        return kept[0] if len(kept) == 1 else np.sqrt(sum((part**2 for part in kept), 0.0 * z))

    def _parts(self, z: np.ndarray, sigma: np.ndarray) -> list[np.ndarray]:
        sizes = ((self.offset_m, lambda: 1.0 / z), (self.share, lambda: np.ones_like(z)),
                 (self.share_per_m, lambda: z), (self.noises, lambda: sigma / z))  # fmt: skip
        return [size * growth() for size, growth in sizes if size > 0.0]

    def field(
        self,
        u: Float[np.ndarray, "n"],
        v: Float[np.ndarray, "n"],
        z: Float[np.ndarray, "n"],
        sigma: Float[np.ndarray, "n"],
        edge: float,
    ) -> Float[np.ndarray, "n k"]:
        """The field as columns: relative errors of depth of one standard deviation each, independent.

        Args:
            u, v: Ray slopes to the right and downwards.
            z, sigma: Depth and its noise, m.
            edge: Ray slope of the image's left and right edge.
        """
        shapes = quadric(u, v, edge)
        sizes = self.parts(z, sigma)
        return np.asarray((sizes[:, :, None] * shapes[:, None, :]).reshape(len(z), -1))


def quadric(
    u: Float[np.ndarray, "n"], v: Float[np.ndarray, "n"], edge: float
) -> Float[np.ndarray, "n 6"]:
    """The shapes of the distortion at ray slopes u, v: 1 at most up to the slope `edge`."""
    return np.stack([(u / edge) ** i * (v / edge) ** j for i, j in ORDERS], axis=1)


@dataclass(frozen=True)
class Bend:
    """Bend of one sensor, as calibrated: `Distortion` is how large that of such sensors is.

    Each value is a relative error of depth at the ray slope of the image's right edge, to the right or as far down. A
    scale of all depths is no part of it, as the motion of the sensor does not show it.
    """

    right: float = setting(
        0.0,
        "",
        "relative error of depth at the right edge, growing with the slope to the right",
        "none: `surefoot calibrate-noise`",
    )
    down: float = setting(0.0, "", "the same with the slope downwards", "none: likewise")
    right_right: float = setting(
        0.0, "", "with the square of the slope to the right", "none: likewise"
    )
    right_down: float = setting(0.0, "", "with the product of both slopes", "none: likewise")
    down_down: float = setting(0.0, "", "with the square of the slope downwards", "none: likewise")

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not abs(value) <= MOST_BEND:
                raise ConfigError(
                    f"bend: {name}={value} must lie within -{MOST_BEND} .. {MOST_BEND}"
                )

    @property
    def coefficients(self) -> Float[np.ndarray, "5"]:
        """In the order of `ORDERS`, without the constant."""
        return np.array([self.right, self.down, self.right_right, self.right_down, self.down_down])

    def and_then(self, rest: Bend) -> Bend:
        """This bend and what was left of it, to first order."""
        return Bend(*(float(value) for value in self.coefficients + rest.coefficients))

    def straightened(
        self, z: Float32[np.ndarray, "h w"], camera: Camera
    ) -> Float32[np.ndarray, "h w"]:
        """A depth image, m, without the bend; the image itself if there is none."""
        if not self.coefficients.any():
            return z
        return z / stretch(camera, self)


@lru_cache(maxsize=8)  # the levels of one camera
def stretch(camera: Camera, bend: Bend) -> Float32[np.ndarray, "h w"]:
    """What a bend multiplies the depth of every pixel by."""
    u, v = (one.ravel() for one in np.broadcast_arrays(*camera.single_slopes))
    shapes = quadric(u, v, camera.width / (2.0 * camera.fx))[:, 1:]
    factor = (1.0 + shapes @ bend.coefficients).reshape(camera.height, camera.width)
    return np.asarray(factor, np.float32)


@dataclass(frozen=True)
class DistortionConfig:
    """Distortion of every kind of sensor as its maker and the literature state it; a calibration replaces it."""

    tof: Distortion = Distortion(offset_m=0.011, share=0.001)  # Azure Kinect; SR-4000: 10 mm
    stereo: Distortion = Distortion(noises=1.0)  # calibrated rigs: .1 to .3 px, as noise of a match
    depth: Distortion = Distortion(share=0.01, share_per_m=0.005)  # Kinect scales; D400 2 % at 2 m

    def of(self, sensor: str | None) -> Distortion:
        """That of a sensor; None or a source of the user's: as an RGB-D camera. ConfigError for an unknown name."""
        if sensor is None or plugins.is_reference(sensor):
            return self.depth
        if sensor not in ("tof", "stereo", "depth"):
            raise ConfigError(f"floor: sensor={sensor!r} is unknown; choose tof, stereo, depth")
        found: Distortion = getattr(self, sensor)
        return found
