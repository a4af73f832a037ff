"""The sphere on which a panorama is drawn: every pixel covers the same angle to the right and upwards.

theta is positive to the right and phi upwards (the signs of the seed; theta is minus the azimuth), both in the
base frame. On a plane the angles would not be linear in the pixel, and eq. (12) of seed 004 would err by
degrees.

Source: Kang 2013 (seed 004), section 4; warp `x = f theta, y = -f phi` after Brown and Lowe 2007.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, Float32, UInt8

from perception.primitives.camera import Camera
from perception.primitives.errors import ConfigError


@dataclass(frozen=True)
class Sphere:
    """A window of the sphere as a grid of pixels; pixel centres at integers.

    Args:
        width: Number of columns; theta increases with them.
        height: Number of rows; phi decreases with them.
        px_per_rad: f, the same along both axes.
        left_rad: theta of column 0.
        top_rad: phi of row 0.
    """

    width: int
    height: int
    px_per_rad: float
    left_rad: float
    top_rad: float

    def __post_init__(self) -> None:
        if self.width < 1 or self.height < 1 or not self.px_per_rad > 0.0:
            raise ConfigError(
                f"sphere: {self.width}x{self.height} px at {self.px_per_rad} px/rad must be positive"
            )

    @staticmethod
    def window(
        left_rad: float, right_rad: float, bottom_rad: float, top_rad: float, px_per_rad: float
    ) -> Sphere:
        """The grid that covers these angles."""
        return Sphere(
            math.ceil((right_rad - left_rad) * px_per_rad) + 1,
            math.ceil((top_rad - bottom_rad) * px_per_rad) + 1,
            px_per_rad,
            left_rad,
            top_rad,
        )

    def angles(
        self, x: Float[np.ndarray, "*n"], y: Float[np.ndarray, "*n"]
    ) -> tuple[Float[np.ndarray, "*n"], Float[np.ndarray, "*n"]]:
        """(theta, phi) of pixels, rad."""
        return self.left_rad + x / self.px_per_rad, self.top_rad - y / self.px_per_rad

    @property
    def rays(self) -> Float[np.ndarray, "h w 3"]:
        """Unit direction of every pixel in the base frame."""
        y, x = np.mgrid[0 : self.height, 0 : self.width].astype(np.float64)
        return direction(*self.angles(x, y))


def direction(
    theta: Float[np.ndarray, "*n"], phi: Float[np.ndarray, "*n"]
) -> Float[np.ndarray, "*n 3"]:
    """Unit vectors of angles, base frame (x ahead, y left, z up)."""
    flat = np.cos(phi)
    return np.stack([flat * np.cos(theta), -flat * np.sin(theta), np.sin(phi)], axis=-1)


def angles_of(
    directions: Float[np.ndarray, "*n 3"],
) -> tuple[Float[np.ndarray, "*n"], Float[np.ndarray, "*n"]]:
    """(theta, phi) of vectors in the base frame, rad."""
    x, y, z = np.moveaxis(directions, -1, 0)
    return np.asarray(np.arctan2(-y, x)), np.asarray(np.arctan2(z, np.hypot(x, y)))


def window_of_view(
    camera: Camera, R_base_camera: Float[np.ndarray, "3 3"], px_per_rad: float
) -> Sphere:
    """The smallest window that contains a view's border, in whole pixels of one common grid.

    Windows of views with the same `px_per_rad` are parts of the same grid, and differ by whole pixels.
    """
    u = np.linspace(-0.5, camera.width - 0.5, 33)
    v = np.linspace(-0.5, camera.height - 0.5, 33)
    border = np.concatenate(
        [
            np.column_stack([u, np.full(33, v[0])]),
            np.column_stack([u, np.full(33, v[-1])]),
            np.column_stack([np.full(33, u[0]), v]),
            np.column_stack([np.full(33, u[-1]), v]),
        ]
    )
    theta, phi = angles_of(camera.back_project(border, np.ones(len(border))) @ R_base_camera.T)
    middle = float(angles_of(R_base_camera[:, 2])[0])
    theta = middle + (theta - middle + np.pi) % (2.0 * np.pi) - np.pi
    left, right = math.floor(theta.min() * px_per_rad), math.ceil(theta.max() * px_per_rad)
    bottom, top = math.floor(phi.min() * px_per_rad), math.ceil(phi.max() * px_per_rad)
    return Sphere(
        right - left + 1, top - bottom + 1, px_per_rad, left / px_per_rad, top / px_per_rad
    )


def look_up(
    sphere: Sphere, camera: Camera, R_base_camera: Float[np.ndarray, "3 3"]
) -> tuple[Float32[np.ndarray, "h w"], Float32[np.ndarray, "h w"]]:
    """Pixel (u, v) of the view for every pixel of the sphere; -1 outside the view."""
    rays = sphere.rays @ R_base_camera
    pixels = camera.project(rays)
    outside = ~camera.contains(pixels)
    pixels[outside] = -1.0
    return pixels[..., 0].astype(np.float32), pixels[..., 1].astype(np.float32)


def warp_picture(
    picture: UInt8[np.ndarray, "h w"], u: Float32[np.ndarray, "a b"], v: Float32[np.ndarray, "a b"]
) -> tuple[UInt8[np.ndarray, "a b"], np.ndarray]:
    """An image of a view warped to the sphere by its look-up table, and the mask of its pixels."""
    shown = u >= 0.0
    warped = cv2.remap(picture, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(warped), shown
