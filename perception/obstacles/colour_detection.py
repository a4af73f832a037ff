"""Obstacles of known colours: their position from one colour image and the floor.

A pixel is assigned to a colour by its chromaticity, which shadows hardly change. The obstacle stands where the ray
through the foot of a patch of one colour meets the floor; the width of the patch there gives the radius. The
covariance includes errors of pixels, head angles and camera height. Patches at the image border have no foot or no
width and are ignored.

Source: Yoo and Kim 2010 (seed 001), section V-A (obstacles found by colour in simulation); chromaticity and errors
ours.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
from jaxtyping import Float, Int8, UInt8

from ..primitives.camera import Camera
from ..primitives.errors import ConfigError
from ..primitives.frame import ColourView
from ..primitives.pose import Pose3
from ..primitives.settings import setting
from .track import Detection

DARKEST = 0.06  # ours: share of white below which chromaticity is noise
LEAST_AREA_PX = 60  # ours: smaller patches are noise or too far
EDGE_SIGMA_PX = 1.0  # ours: of the foot and of both sides
HEAD_YAW_SIGMA_RAD = math.radians(0.5)  # walking trials: offset and backlash
HEAD_PITCH_SIGMA_RAD = math.radians(0.7)  # walking trials: the same, and the gait
CAMERA_HEIGHT_SIGMA_M = 0.004  # walking trials: trunk tilt of 0.6 deg, 0.38 m above the floor
LARGEST_RADIUS_M = 0.35  # ours: larger patches are furniture of that colour


@dataclass(frozen=True)
class ColouredConfig:
    """The colours that are searched for."""

    colours: tuple[str, ...] = setting(
        (), "", 'colours of obstacles, as "#e88028"; none: no search', "seed 001"
    )
    tolerance: float = (
        0.06  # ours: orange and oak are 0.2 apart; largest difference in chromaticity
    )
    farthest_m: float = (
        2.5  # ours: half a degree of pitch is 15 cm; range beyond which obstacles are ignored
    )

    def __post_init__(self) -> None:
        for colour in self.colours:
            if not re.fullmatch(r"#[0-9a-fA-F]{6}", colour):
                raise ConfigError(
                    f"coloured: colour {colour!r} is invalid; write it as red, green, blue: #e88028"
                )
        for name in ("tolerance", "farthest_m"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"coloured: {name}={value} must be positive and finite")


@dataclass(frozen=True)
class Patch:
    """A connected region of one colour in an image.

    Args:
        left, right: Columns of its sides, px.
        side: Row at which the sides are measured, px.
        foot: Row of its lower end in the middle, px.
        top: Row of its upper end, px.
    """

    left: float
    right: float
    side: float
    foot: float
    top: float


def detect(view: ColourView, config: ColouredConfig) -> list[Detection]:
    """Obstacles of the known colours on the floor, body frame.

    Args:
        view: Image with the pose of the camera on the body; without a pose there are no detections.
        config: Colours.
    """
    if view.T_body_camera is None or not config.colours:
        return []
    found = []
    for patch in patches(view.rgb, config):
        detection = _locate(patch, view.camera, view.T_body_camera, config.farthest_m)
        if detection is not None:
            found.append(detection)
    return found


def patches(rgb: UInt8[np.ndarray, "h w 3"], config: ColouredConfig) -> list[Patch]:
    """Patches of each colour that do not touch the image border."""
    height, width = rgb.shape[:2]
    labels = nearest_colour(rgb, config)
    found = []
    for colour in range(len(config.colours)):
        mask = (labels == colour).astype(np.uint8)
        for clean in (cv2.MORPH_CLOSE, cv2.MORPH_OPEN):
            mask = np.asarray(cv2.morphologyEx(mask, clean, np.ones((3, 3), np.uint8)))
        count, parts, boxes, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
        for part in range(1, count):
            x, y, w, h, area = (int(v) for v in boxes[part])
            cut = x <= 1 or x + w >= width - 1 or y + h >= height - 1
            if cut or area < LEAST_AREA_PX:
                continue
            found.append(_patch(parts[y : y + h, x : x + w] == part, x, y))
    return found


def nearest_colour(
    rgb: UInt8[np.ndarray, "h w 3"], config: ColouredConfig
) -> Int8[np.ndarray, "h w"]:
    """Index of the colour of each pixel; -1 where it is none of them."""
    parts = (rgb >> 2).astype(np.int32)
    return _labels(config)[(parts[..., 0] << 12) | (parts[..., 1] << 6) | parts[..., 2]]


@cache
def _labels(config: ColouredConfig) -> Int8[np.ndarray, "262144"]:
    """Lookup table of `nearest_colour` for every colour of six bits per channel."""
    levels = np.indices((64, 64, 64)).reshape(3, -1).T * 4 + 1.5
    total = levels.sum(axis=1)
    share = levels[:, :2] / total[:, None]
    best = np.full(len(levels), config.tolerance**2)
    labels = np.full(len(levels), -1, np.int8)
    for number, colour in enumerate(config.colours):
        known = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)])
        away = np.square(share - known[:2] / max(known.sum(), 1)).sum(axis=1)
        labels[away < best] = number
        best = np.minimum(best, away)
    labels[total < 3 * 255 * DARKEST] = -1
    return labels


def _patch(mask: np.ndarray, x: int, y: int) -> Patch:
    """Sides in the third quarter of its rows, above the rounding of its foot; foot in its middle third."""
    h = len(mask)
    rows = np.arange(h // 2, max(3 * h // 4, h // 2 + 1))
    part = mask[rows]
    left = float(np.median(np.argmax(part, axis=1)))
    right = float(np.median(part.shape[1] - 1 - np.argmax(part[:, ::-1], axis=1)))
    third = round((right - left) / 3)
    middle = mask[:, round(left) + third : max(round(right) - third, round(left) + third) + 1]
    lowest = h - 1 - np.argmax(middle[::-1], axis=0)
    foot = float(np.median(lowest[middle.any(axis=0)])) if middle.any() else h - 1.0
    return Patch(x + left - 0.5, x + right + 0.5, y + float(rows.mean()), y + foot + 0.5, float(y))


def _locate(
    patch: Patch, camera: Camera, T_body_camera: Pose3, farthest_m: float
) -> Detection | None:
    """The obstacle of a patch; None if its foot is not on the floor, or it is too far or too large."""
    sigmas = np.diag(
        [*[EDGE_SIGMA_PX] * 3, HEAD_YAW_SIGMA_RAD, HEAD_PITCH_SIGMA_RAD, CAMERA_HEIGHT_SIGMA_M]
    )
    nominal = np.array([[patch.left, patch.right, patch.foot, 0.0, 0.0, 0.0]])
    measured = np.concatenate([nominal, nominal + sigmas, nominal - sigmas])
    left, right, foot = measured[:, :3].T
    side = np.full(len(measured), patch.side)
    u, v = np.stack([left, right, (left + right) / 2]), np.stack([side, side, foot])
    rays = camera.back_project(np.stack([u.T, v.T], axis=-1), np.ones((len(measured), 3)))
    ahead = rays @ T_body_camera.rotation.T
    discs = [
        _disc(three, errors, T_body_camera.translation)
        for three, errors in zip(ahead, measured[:, 3:], strict=True)
    ]
    found = np.array([disc for disc in discs if disc is not None])
    if len(found) < len(discs) or found[0, 2] > LARGEST_RADIUS_M:
        return None
    disc = found[0]
    if math.hypot(disc[0], disc[1]) > farthest_m:
        return None
    root = (found[1:7, :2] - found[7:, :2]).T / 2.0
    top = _top_m(patch, disc, camera, T_body_camera)
    return Detection(disc[:2], root @ root.T, float(disc[2]), top)


def _disc(
    ahead: Float[np.ndarray, "3 3"],
    errors: Float[np.ndarray, "3"],
    place: tuple[float, float, float],
) -> Float[np.ndarray, "3"] | None:
    """(x, y, radius) of the disc on the floor, body frame, m; None if the foot is above the horizon.

    Args:
        ahead: Rays of both sides and of the foot, body axes.
        errors: Of yaw and pitch, rad, and of height, m.
        place: Nominal camera on the body, m.
    """
    yaw, pitch, height = errors
    eye_height = place[2] + height
    pan = math.atan2(ahead[2, 1], ahead[2, 0])
    tilted = _turn(pan + yaw) @ _pitch(pitch) @ _turn(-pan) @ ahead.T
    x, y, z = tilted
    if z[2] > -1e-3:
        return None
    reach = eye_height / -z[2] * math.hypot(x[2], y[2])
    bearings = np.arctan2(y, x)
    half = 0.5 * abs(math.remainder(bearings[0] - bearings[1], math.tau))
    if half > 1.2:
        return None
    distance = reach / (1.0 - math.sin(half))
    middle = bearings[1] + 0.5 * math.remainder(bearings[0] - bearings[1], math.tau)
    return np.array(
        [
            place[0] + distance * math.cos(middle),
            place[1] + distance * math.sin(middle),
            distance * math.sin(half),
        ]
    )


def _top_m(patch: Patch, disc: np.ndarray, camera: Camera, T_body_camera: Pose3) -> float:
    """Height of the top of the patch above the floor, taken at its front, m."""
    pixel = np.array([[(patch.left + patch.right) / 2, patch.top]])
    ray = T_body_camera.rotation @ camera.back_project(pixel, np.ones(1))[0]
    place = T_body_camera.translation
    away = math.hypot(disc[0] - place[0], disc[1] - place[1]) - float(disc[2])
    return float(place[2] + away * ray[2] / max(math.hypot(ray[0], ray[1]), 1e-9))


def _turn(yaw: float) -> np.ndarray:
    """Rotation about z."""
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _pitch(angle: float) -> np.ndarray:
    """Rotation about y; positive is down."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
