"""Geometric sensor: detections of discs without rendering, with the errors and the misses of the real detectors.

Rendering half a minute of a walk takes a minute; this takes milliseconds. A disc is detected if it lies inside the
field of view, unoccluded, with its foot in the image, in the share of frames in which images show it whole; else, and if
only a part of it is in view, the time-of-flight camera gives that part as a truncated detection. The errors are those
of images: for the time-of-flight camera a share of the radius, for the colour camera the pitch of a swaying head, and
for both its yaw, which all discs of one frame share.

Shares and errors were measured once by the pipeline from images, in 554 frames of the hard course, seeds 1000 and 1001
(90 s each). In none of them did the time-of-flight camera see an obstacle where there is none; the colour camera
mistakes the visible part of a disc for the whole.

Source: ours; fields of view of seeds 004 and 000.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

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

# measured in those 554 frames
SURE_M, LOSS_PER_M = 0.9, 0.33  # whole in every frame up to this range; share lost per metre beyond
REPEATS = 0.3  # share of frames whose outcome is that of the frame before
FITTED_M, FITTED_SHARE = 1.0, 0.5
"""Range up to which a circle is fitted to truncated discs, and the share of them for which it is accepted."""
COLOUR_SHARE, COLOUR_SURE_M = 0.84, 1.5  # the same of the colour camera, up to this range
PART_SHARE = 0.3  # of the partly hidden discs that the colour camera takes for whole ones
PART_RAD = math.radians(1.0)  # least visible width of a part


@dataclass(frozen=True)
class SeenDisc:
    """Detection of one disc in one frame.

    Args:
        index: Index of the given disc, for evaluation only.
        position: Measured centre, body frame, m.
        covariance: As the detector claims it, m^2.
        radius_m: Measured radius.
        whole: Whether the detector takes it for whole; of a truncated one position and radius are of the visible part.
    """

    index: int
    position: Float[np.ndarray, "2"]
    covariance: Float[np.ndarray, "2 2"]
    radius_m: float
    whole: bool = True


class GeometricSensor:
    """Takes one look per frame; the joint offsets are constant within a run."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        offset = math.radians(OFFSET_DEG)
        self._offset_yaw, self._offset_pitch = (float(v) for v in offset * rng.standard_normal(2))
        self._luck = np.zeros(
            (2, 0)
        )  # by camera and disc: detected whole if below the share of its range

    def look(
        self, discs: Float[np.ndarray, "n 3"], pan_rad: float, tilt_rad: float, colour: bool
    ) -> list[SeenDisc]:
        """Detections of one frame.

        Args:
            discs: x, y in the true body frame, radius, m.
            pan_rad, tilt_rad: Of the head, left and down positive.
            colour: Whether the colour camera takes an image in this frame.
        """
        away, bearing = np.hypot(discs[:, 0], discs[:, 1]), np.arctan2(discs[:, 1], discs[:, 0])
        half = np.arcsin(np.minimum(discs[:, 2] / np.maximum(away, discs[:, 2]), 1.0))
        self._draw_luck(len(discs))
        yaw = self._offset_yaw + math.radians(YAW_DEG) * self._rng.standard_normal()
        pitch = self._offset_pitch + math.radians(PITCH_DEG) * self._rng.standard_normal()
        seen = []
        parts, complete = _visible(away, bearing, half, pan_rad, TOF_ACROSS_DEG)
        share = 1.0 - LOSS_PER_M * np.maximum(away - SURE_M, 0.0)
        whole = self._luck[0] < np.where(complete, share, FITTED_SHARE * (away <= FITTED_M))
        for k in np.flatnonzero(self._by_tof(away, tilt_rad) & _wide(parts)).tolist():
            disc = discs[k] if whole[k] else _part(discs[k], parts[k])
            seen.append(self._measured_by_tof(k, disc, yaw, bool(whole[k])))
        if not colour:
            return seen
        parts, complete = _visible(away, bearing, half, pan_rad, COLOUR_DEG)
        share = COLOUR_SHARE - LOSS_PER_M * np.maximum(away - COLOUR_SURE_M, 0.0)
        found = self._by_colour(away, bearing - pan_rad, half, tilt_rad, discs[:, 2])
        found &= _wide(parts) & (self._luck[1] < np.where(complete, share, PART_SHARE))
        found[[one.index for one in seen if one.whole]] = False
        for k in np.flatnonzero(found).tolist():
            disc = discs[k] if complete[k] else _part(discs[k], parts[k])
            seen.append(self._measured_by_colour(k, disc, yaw, pitch))
        return seen

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

    def _draw_luck(self, count: int) -> None:
        """Draw for each camera and disc whether it is detected whole; some keep the draw of the frame before."""
        drawn, again = self._rng.random((2, 2, count))
        before = self._luck if self._luck.shape[1] == count else drawn
        self._luck = np.where(again < REPEATS, before, drawn)

    def _by_tof(self, away: np.ndarray, tilt_rad: float) -> np.ndarray:
        """Which discs have their foot in the image of the time-of-flight camera, by their distance."""
        nearest, farthest = self.floor_reach(tilt_rad)
        return np.asarray((away <= farthest) & (away >= 0.5 * nearest))

    def _by_colour(
        self,
        away: np.ndarray,
        off: np.ndarray,
        half: np.ndarray,
        tilt_rad: float,
        radius: np.ndarray,
    ) -> np.ndarray:
        """Which discs the colour image contains up to both sides, with their foot."""
        edge = math.radians(COLOUR_DEG) / 2
        across = np.abs((off + math.pi) % (2 * math.pi) - math.pi) + half
        foot = np.arctan2(EYE_M, np.maximum(away - radius, 1e-3)) - tilt_rad
        return np.asarray((across <= edge) & (np.abs(foot) <= edge) & (away <= COLOUR_REACH_M))

    def _measured_by_tof(self, index: int, disc: np.ndarray, yaw: float, whole: bool) -> SeenDisc:
        sigmas = np.array([TOF_ALONG_M, TOF_ACROSS_M])
        return replace(self._measured(index, disc, yaw, 0.7 * sigmas, sigmas), whole=whole)

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


def _visible(
    away: np.ndarray, bearing: np.ndarray, half: np.ndarray, pan_rad: float, across_deg: float
) -> tuple[Float[np.ndarray, "n 2"], Bool[np.ndarray, "n"]]:
    """The visible part of each disc in a view about a pan, as offsets from its direction, rad; whether it is all."""
    parts = np.empty((len(away), 2))
    view = np.array([pan_rad, math.radians(across_deg) / 2])
    kernels.find_visible(away, bearing, half, view, math.radians(APART_DEG), parts)
    return parts, parts[:, 1] - parts[:, 0] >= 2.0 * half - 1e-9


def _wide(parts: Float[np.ndarray, "n 2"]) -> Bool[np.ndarray, "n"]:
    """Which parts are wide enough to be noticed."""
    return np.asarray(parts[:, 1] - parts[:, 0] > PART_RAD)


def _part(disc: np.ndarray, part: np.ndarray) -> Float[np.ndarray, "3"]:
    """The disc that covers the visible part of another and has its front, body frame, m."""
    away, bearing = math.hypot(disc[0], disc[1]), math.atan2(disc[1], disc[0])
    low, high = part.tolist()
    radius = min(away * math.sin((high - low) / 2.0), float(disc[2]))
    centre, at = away - float(disc[2]) + radius, bearing + (low + high) / 2.0
    return np.array([centre * math.cos(at), centre * math.sin(at), radius])
