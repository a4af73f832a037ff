"""Geometric sensor: detections of discs without rendering, with the errors of the real detectors.

Rendering half a minute of a walk takes a minute; this takes milliseconds. A disc is detected if it lies inside the
field of view, unoccluded, with its foot in the image. The errors are those of images: for the time-of-flight camera a
share of the radius, for the colour camera the pitch of a swaying head, and for both its yaw, which all discs of one
frame share. A disc that the border of the view cuts off is never detected, while images locate some of those nearby.

Source: ours; fields of view of seeds 004 and 000; errors as the detectors of `perception` claim them, confirmed by
walks.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from ..rendering import _visibility_kernels as kernels

EYE_M = 0.383  # DARwIn-OP walking, head tilted by 30 deg
TOF_ACROSS_DEG, TOF_DOWN_DEG = 44.0, 35.0  # seed 004
TOF_REACH_M = 3.0  # reach of the pipeline
TOF_ALONG_M, TOF_ACROSS_M = 0.0144, 0.0093  # claimed by clustering for a disc of 10 cm
COLOUR_DEG = 90.0  # seed 000, horizontal and vertical
COLOUR_REACH_M = 2.5  # reach of colour detection
EDGE_DEG = 0.16  # a pixel of the colour camera, each edge
YAW_DEG, PITCH_DEG = 0.4, 0.6  # sway of neck and trunk, unseen by the encoders
OFFSET_DEG = 0.3  # joint offsets, constant within a run
CLAIMED_YAW_DEG, CLAIMED_PITCH_DEG = 0.5, 0.7  # claimed by colour detection
APART_DEG = 0.5  # ours: discs closer than this in the image merge
RADIUS_SHARE = 0.05  # ours: error of the radius


@dataclass(frozen=True)
class SeenDisc:
    """Detection of one disc in one frame.

    Args:
        index: Index of the given disc, for evaluation only.
        position: Measured centre, body frame, m.
        covariance: As the detector claims it, m^2.
        radius_m: Measured radius.
    """

    index: int
    position: Float[np.ndarray, "2"]
    covariance: Float[np.ndarray, "2 2"]
    radius_m: float


class GeometricSensor:
    """Takes one look per frame; the joint offsets are constant within a run."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        offset = math.radians(OFFSET_DEG)
        self._offset_yaw, self._offset_pitch = (float(v) for v in offset * rng.standard_normal(2))

    def look(
        self, discs: Float[np.ndarray, "n 3"], pan_rad: float, tilt_rad: float, colour: bool
    ) -> list[SeenDisc]:
        """Detections of one frame.

        Args:
            discs: x, y in the true body frame, radius, m.
            pan_rad, tilt_rad: Of the head, left and down positive.
            colour: Whether the colour camera takes an image in this frame.
        """
        away = np.hypot(discs[:, 0], discs[:, 1])
        bearing = np.arctan2(discs[:, 1], discs[:, 0])
        half = np.arcsin(np.minimum(discs[:, 2] / np.maximum(away, discs[:, 2]), 1.0))
        hidden = np.empty(len(discs), np.bool_)
        kernels.find_occluded(away, bearing, half, math.radians(APART_DEG), hidden)
        off = np.abs((bearing - pan_rad + math.pi) % (2 * math.pi) - math.pi) + half
        by_tof = self._by_tof(away, off, tilt_rad) & ~hidden
        by_colour = np.zeros(len(discs), np.bool_)
        if colour:
            by_colour = self._by_colour(away, off, tilt_rad, discs[:, 2]) & ~hidden & ~by_tof
        yaw = self._offset_yaw + math.radians(YAW_DEG) * self._rng.standard_normal()
        pitch = self._offset_pitch + math.radians(PITCH_DEG) * self._rng.standard_normal()
        seen = [self._measured_by_tof(k, discs[k], yaw) for k in np.flatnonzero(by_tof).tolist()]
        return seen + [
            self._measured_by_colour(k, discs[k], yaw, pitch)
            for k in np.flatnonzero(by_colour).tolist()
        ]

    def rays(
        self, discs: Float[np.ndarray, "n 3"], walls: Float[np.ndarray, "4"], origin: np.ndarray
    ) -> tuple[Float[np.ndarray, "m"], Int[np.ndarray, "m"]]:
        """Free length of rays across the view, and the obstacle that ends each.

        Args:
            discs: World frame.
            walls: x_min, y_min, x_max, y_max of the room.
            origin: (m, 3), start and direction (rad) of each ray, world frame.

        Returns:
            Distances, m, and the index of the disc hit, -1 for a wall.
        """
        distance, what = np.empty(len(origin)), np.empty(len(origin), np.int64)
        kernels.cast_rays(np.ascontiguousarray(origin), discs, walls, distance, what)
        return distance, what

    def floor_reach(self, tilt_rad: float) -> tuple[float, float]:
        """Nearest and farthest floor in the view of the time-of-flight camera, m."""
        half = math.radians(TOF_DOWN_DEG) / 2
        low, high = tilt_rad + half, tilt_rad - half
        nearest = EYE_M / math.tan(min(low, 1.55))
        farthest = math.inf if high <= 1e-3 else EYE_M / math.tan(high)
        return nearest, min(farthest, TOF_REACH_M)

    def _by_tof(self, away: np.ndarray, off: np.ndarray, tilt_rad: float) -> np.ndarray:
        nearest, farthest = self.floor_reach(tilt_rad)
        across = off <= math.radians(TOF_ACROSS_DEG) / 2
        return np.asarray(across & (away <= farthest) & (away >= 0.5 * nearest))

    def _by_colour(
        self, away: np.ndarray, off: np.ndarray, tilt_rad: float, radius: np.ndarray
    ) -> np.ndarray:
        half = math.radians(COLOUR_DEG) / 2
        foot = np.arctan2(EYE_M, np.maximum(away - radius, 1e-3)) - tilt_rad
        inside = (off <= half) & (np.abs(foot) <= half)
        return np.asarray(inside & (away <= COLOUR_REACH_M))

    def _measured_by_tof(self, index: int, disc: np.ndarray, yaw: float) -> SeenDisc:
        sigmas = np.array([TOF_ALONG_M, TOF_ACROSS_M])
        return self._measured(index, disc, yaw, 0.7 * sigmas, sigmas)

    def _measured_by_colour(
        self, index: int, disc: np.ndarray, yaw: float, pitch: float
    ) -> SeenDisc:
        away = float(np.hypot(disc[0], disc[1]))
        slope = (away**2 + EYE_M**2) / EYE_M
        edge, claimed = math.radians(EDGE_DEG), math.radians(CLAIMED_PITCH_DEG)
        sigmas = slope * math.hypot(claimed, edge), away * math.radians(CLAIMED_YAW_DEG)
        noise = np.array([slope * edge, away * edge])
        return self._measured(index, disc, yaw, noise, np.array(sigmas), slope * pitch)

    def _measured(
        self,
        index: int,
        disc: np.ndarray,
        yaw: float,
        noise: np.ndarray,
        claimed: np.ndarray,
        extra_m: float = 0.0,
    ) -> SeenDisc:
        """Detection with the yaw error of the head and errors along and across the ray."""
        away = float(np.hypot(disc[0], disc[1]))
        ahead = disc[:2] / max(away, 1e-6)
        axes = np.stack([ahead, [-ahead[1], ahead[0]]])
        along, across = noise * self._rng.standard_normal(2)
        position = disc[:2] + axes.T @ np.array([along + extra_m, across + yaw * away])
        radius = float(disc[2]) * (1.0 + RADIUS_SHARE * float(self._rng.standard_normal()))
        return SeenDisc(index, position, axes.T @ np.diag(claimed**2) @ axes, radius)
