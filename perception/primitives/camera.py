"""Camera model: pinhole with radial and tangential lens distortion.

Source: Brown-Conrady with 5 coefficients, OpenCV's rational polynomial with 8 (ROS: plumb_bob and
rational_polynomial).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from numbers import Integral, Real

import numpy as np
from jaxtyping import Bool, Float, Float32, Int
from numpy.polynomial import Polynomial

from .errors import ConfigError, InputError

MOST_DISTORTION, LEAST_DISTORTION = 1e6, 1e-12  # beyond any lens; without effect


@dataclass(frozen=True)
class Camera:
    """Intrinsics in pixels; pixel centres at integers, so the image spans [-0.5, width - 0.5].

    `distortion` is (k1, k2, p1, p2, k3), for a rational lens also (k4, k5, k6), in OpenCV's order; all zero for a
    rectified image.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        for name in ("width", "height"):
            if not isinstance(getattr(self, name), Integral):
                raise ConfigError(
                    f"camera: {name}={getattr(self, name)!r} px must be a whole number"
                )
        for name in ("fx", "fy", "cx", "cy"):
            if not isinstance(getattr(self, name), Real):
                raise ConfigError(f"camera: {name}={getattr(self, name)!r} px must be a number")
        try:
            object.__setattr__(self, "distortion", tuple(map(float, self.distortion)))
        except (TypeError, ValueError) as error:
            raise ConfigError(
                f"camera: distortion={self.distortion!r} must be 5 or 8 numbers"
            ) from error
        if self.width < 1 or self.height < 1:
            raise ConfigError(f"camera: image {self.width}x{self.height} px must be at least 1x1")
        for name in ("fx", "fy"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(
                    f"camera: {name}={value} px must be positive and finite; check the intrinsics"
                )
        for name, size in (("cx", self.width), ("cy", self.height)):
            value = getattr(self, name)
            if not -size <= value <= 2 * size:
                raise ConfigError(
                    f"camera: {name}={value} px lies far outside the image of {size} px; check the intrinsics"
                )
        small = all(abs(value) <= MOST_DISTORTION for value in self.distortion)
        if len(self.distortion) not in (5, 8) or not small:
            raise ConfigError(
                f"camera: distortion={self.distortion} must be 5 finite numbers (k1, k2, p1, p2, k3) or 8 "
                f"(also k4, k5, k6), none beyond {MOST_DISTORTION:g}; check the intrinsics"
            )

    @staticmethod
    def from_view(width: int, height: int, across_rad: float, down_rad: float) -> Camera:
        """Distortion-free camera from its horizontal and vertical field of view, centred in the image."""
        return Camera(
            width,
            height,
            width / 2 / math.tan(across_rad / 2),
            height / 2 / math.tan(down_rad / 2),
            (width - 1) / 2,
            (height - 1) / 2,
        )

    @property
    def matrix(self) -> Float[np.ndarray, "3 3"]:
        """K, px."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @property
    def is_distorted(self) -> bool:
        """Whether the lens has distortion."""
        return any(self.distortion)

    @cached_property
    def rays(self) -> Float[np.ndarray, "height width 3"]:
        """Ray (x, y, 1) of each pixel in the camera frame, without distortion."""
        v, u = np.mgrid[0 : self.height, 0 : self.width].astype(np.float64)
        x, y = self._undistort((u - self.cx) / self.fx, (v - self.cy) / self.fy)
        rays = np.stack([x, y, np.ones_like(x)], axis=-1)
        rays.setflags(write=False)
        return rays

    @cached_property
    def slopes(self) -> tuple[Float[np.ndarray, "a width"], Float[np.ndarray, "height b"]]:
        """Ray slopes x/z and y/z of every pixel, in shapes that broadcast to the image."""
        if self.is_distorted:
            return self.rays[..., 0], self.rays[..., 1]
        x = (np.arange(self.width) - self.cx) / self.fx
        y = (np.arange(self.height) - self.cy) / self.fy
        return x[None, :], y[:, None]

    @cached_property
    def single_slopes(
        self,
    ) -> tuple[Float32[np.ndarray, "a width"], Float32[np.ndarray, "height b"]]:
        """`slopes` in single precision and contiguous, for compiled loops."""
        x, y = self.slopes
        return np.ascontiguousarray(x, np.float32), np.ascontiguousarray(y, np.float32)

    @cached_property
    def largest_slope(self) -> float:
        """Slope hypot(x/z, y/z) up to which the distorted radius grows with it; rays beyond it have no pixel.

        The radius r top(r^2) / below(r^2) stops growing where its derivative or `below` is zero.
        """
        k1, k2, _, _, k3, *rational = self.distortion
        top, below, square = (Polynomial(c) for c in ([1, k1, k2, k3], [1, *rational], [0, 1]))
        growth = top * below + 2 * square * (top.deriv() * below - top * below.deriv())
        zeros = np.concatenate([one.trim(LEAST_DISTORTION).roots() for one in (growth, below)])
        ends = zeros.real[(np.abs(zeros.imag) < 1e-9) & (zeros.real > 0.0)]
        return math.sqrt(ends.min(initial=np.inf))

    def back_project(
        self, pixels: Float[np.ndarray, "*n 2"], depth: Float[np.ndarray, "*n"]
    ) -> Float[np.ndarray, "*n 3"]:
        """Points in the camera frame, m, of pixels (u, v) at depth z, m; NaN for NaN depth."""
        x, y = self._undistort(
            np.asarray((pixels[..., 0] - self.cx) / self.fx),
            np.asarray((pixels[..., 1] - self.cy) / self.fy),
        )
        return np.stack([x * depth, y * depth, depth], axis=-1)

    def project(self, points: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 2"]:
        """Pixels (u, v) of points in the camera frame, m; NaN behind it and beyond the largest slope of its lens."""
        z = np.where(points[..., 2] > 1e-9, points[..., 2], np.nan)
        x, y = np.asarray(points[..., 0] / z), np.asarray(points[..., 1] / z)
        if self.is_distorted:
            x = np.where(np.hypot(x, y) <= self.largest_slope, x, np.nan)
        x, y = self._distort(x, y)
        return np.stack([self.fx * x + self.cx, self.fy * y + self.cy], axis=-1)

    def nearest_pixels(
        self, points: Float[np.ndarray, "n 3"]
    ) -> tuple[Bool[np.ndarray, "n"], Int[np.ndarray, "n"], Int[np.ndarray, "n"]]:
        """Whether each point in the camera frame, m, is in the image, and its column and row, clipped to it."""
        pixels = self.project(points)
        inside = self.contains(pixels)
        pixels[~inside] = 0.0
        u, v = np.rint(pixels.T).astype(int)
        return inside, np.clip(u, 0, self.width - 1), np.clip(v, 0, self.height - 1)

    def contains(self, pixels: Float[np.ndarray, "*n 2"]) -> np.ndarray:
        """Whether each pixel (u, v) is in the image."""
        u, v = pixels[..., 0], pixels[..., 1]
        with np.errstate(invalid="ignore"):
            return np.asarray(
                (u >= -0.5) & (u <= self.width - 0.5) & (v >= -0.5) & (v <= self.height - 0.5)
            )

    def check_image(self, name: str, image: np.ndarray) -> None:
        """Raise InputError unless the image has the size of the camera; `name` is for the message."""
        if image.shape[:2] != (self.height, self.width):
            raise InputError(
                f"{name} image is {image.shape[:2]}, its camera has {(self.height, self.width)} (rows, "
                "columns); check the intrinsics"
            )

    def _distort(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        if not self.is_distorted:
            return x, y
        k1, k2, p1, p2, k3, *below = self.distortion
        r2 = x * x + y * y
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        if below:
            k4, k5, k6 = below
            radial = radial / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
        return (
            x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
            y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
        )

    def _undistort(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Invert the distortion by Newton's method with a numerical Jacobian; accurate to 1e-12."""
        if not self.is_distorted:
            return x, y
        step = 1e-6
        px, py = x.copy(), y.copy()
        for _ in range(10):
            ex, ey = self._distort(px, py)
            ax, ay = self._distort(px + step, py)
            bx, by = self._distort(px, py + step)
            j00, j10, j01, j11 = (
                (ax - ex) / step,
                (ay - ey) / step,
                (bx - ex) / step,
                (by - ey) / step,
            )
            det = j00 * j11 - j01 * j10
            dx, dy = ex - x, ey - y
            px = px - (j11 * dx - j01 * dy) / det
            py = py - (j00 * dy - j10 * dx) / det
        return px, py
