"""What the cameras would show, without pictures: round items in view, unhidden, with the errors of a real look.

Rendering half a minute of a walk takes a minute; this takes milliseconds. It asks for a disc what an image
answers: is all of it inside the view, is it hidden, is its foot in the picture; and it errs as images do:
the time-of-flight camera by a share of the item's radius, the colour camera by the pitch of a trembling head,
both by its yaw, which all items of one instant have wrong alike. It shows less than pictures do: of what the
view cuts off nothing, where pictures place a round item close by.

Source: ours; fields of view of seeds 004 and 000, errors those that the detectors of `perception` claim and
walks have confirmed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from perception.primitives.errors import ConfigError

from ..ranges import check_ranges
from ..rendering import _visibility_kernels as kernels


@dataclass(frozen=True)
class GeometricSensorConfig:
    """Views, reach and errors."""

    eye_m: float = 0.383  # DARwIn-OP walking, head tilted by 30 deg
    tof_across_deg: float = 44.0  # seed 004
    tof_down_deg: float = 35.0  # seed 004
    tof_reach_m: float = 3.0  # as the pipeline believes it
    tof_along_m: float = 0.0144  # what `clusters` claims of a disc of 10 cm, along the ray
    tof_across_m: float = 0.0093  # the same, across it
    colour_deg: float = 90.0  # seed 000, both ways
    colour_reach_m: float = 2.5  # as `coloured` believes it
    edge_deg: float = 0.16  # a pixel of the colour camera, each edge
    yaw_deg: float = 0.4  # sway of the neck, which the encoders do not feel
    pitch_deg: float = 0.6  # the same of the trunk, ahead or aside
    zero_deg: float = 0.3  # the joints sit askew, one value a run
    claimed_yaw_deg: float = 0.5  # as `coloured` claims
    claimed_pitch_deg: float = 0.7
    apart_deg: float = 0.5  # less between two items in the picture and they are one patch

    def __post_init__(self) -> None:
        for name, value in self.__dict__.items():
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"geometric sensor: {name}={value} must be positive and finite")
        view = (0.0, 170.0)
        check_ranges(
            "geometric sensor", self, tof_across_deg=view, tof_down_deg=view, colour_deg=view
        )


@dataclass(frozen=True)
class SeenDisc:
    """One round item in one frame.

    Args:
        index: Which of the discs given it is; for evaluation alone.
        position: Of its middle as measured, body frame, m.
        covariance: As a detector would claim it, m^2.
        radius_m: As measured.
    """

    index: int
    position: Float[np.ndarray, "2"]
    covariance: Float[np.ndarray, "2 2"]
    radius_m: float


class GeometricSensor:
    """Looks once per frame; the errors of the joints stay for a run."""

    def __init__(self, config: GeometricSensorConfig, rng: np.random.Generator) -> None:
        self.config = config
        self._rng = rng
        zero = math.radians(config.zero_deg)
        self._zero_yaw, self._zero_pitch = (float(v) for v in zero * rng.standard_normal(2))

    def look(
        self,
        discs: Float[np.ndarray, "n 3"],
        pan_rad: float,
        tilt_rad: float,
        colour: bool,
    ) -> list[SeenDisc]:
        """What this frame shows.

        Args:
            discs: x, y in the true body frame, radius, m.
            pan_rad, tilt_rad: Of the head, left and down positive.
            colour: Whether the colour camera takes a picture at this instant.
        """
        config = self.config
        away = np.hypot(discs[:, 0], discs[:, 1])
        bearing = np.arctan2(discs[:, 1], discs[:, 0])
        half = np.arcsin(np.minimum(discs[:, 2] / np.maximum(away, discs[:, 2]), 1.0))
        hidden = np.empty(len(discs), np.bool_)
        kernels.find_occluded(away, bearing, half, math.radians(config.apart_deg), hidden)
        off = np.abs((bearing - pan_rad + math.pi) % (2 * math.pi) - math.pi) + half
        by_tof = self._by_tof(away, off, tilt_rad) & ~hidden
        by_colour = np.zeros(len(discs), np.bool_)
        if colour:
            by_colour = self._by_colour(away, off, tilt_rad, discs[:, 2]) & ~hidden & ~by_tof
        yaw = self._zero_yaw + math.radians(config.yaw_deg) * self._rng.standard_normal()
        pitch = self._zero_pitch + math.radians(config.pitch_deg) * self._rng.standard_normal()
        seen = [self._measured_by_tof(k, discs[k], yaw) for k in np.flatnonzero(by_tof).tolist()]
        return seen + [
            self._measured_by_colour(k, discs[k], yaw, pitch)
            for k in np.flatnonzero(by_colour).tolist()
        ]

    def rays(
        self, discs: Float[np.ndarray, "n 3"], walls: Float[np.ndarray, "4"], origin: np.ndarray
    ) -> tuple[Float[np.ndarray, "m"], Int[np.ndarray, "m"]]:
        """How far the view is free along rays all across it, and what ends it.

        Args:
            discs: World frame.
            walls: x_min, y_min, x_max, y_max of the room.
            origin: (m, 3), where each ray begins and its direction, rad, world frame.

        Returns:
            Distances, m, and the disc met, -1 a wall.
        """
        distance, what = np.empty(len(origin)), np.empty(len(origin), np.int64)
        kernels.cast_rays(np.ascontiguousarray(origin), discs, walls, distance, what)
        return distance, what

    def floor_reach(self, tilt_rad: float) -> tuple[float, float]:
        """Nearest and farthest floor that the time-of-flight camera shows, m."""
        half = math.radians(self.config.tof_down_deg) / 2
        low, high = tilt_rad + half, tilt_rad - half
        nearest = self.config.eye_m / math.tan(min(low, 1.55))
        farthest = math.inf if high <= 1e-3 else self.config.eye_m / math.tan(high)
        return nearest, min(farthest, self.config.tof_reach_m)

    def _by_tof(self, away: np.ndarray, off: np.ndarray, tilt_rad: float) -> np.ndarray:
        nearest, farthest = self.floor_reach(tilt_rad)
        across = off <= math.radians(self.config.tof_across_deg) / 2
        return np.asarray(across & (away <= farthest) & (away >= 0.5 * nearest))

    def _by_colour(
        self, away: np.ndarray, off: np.ndarray, tilt_rad: float, radius: np.ndarray
    ) -> np.ndarray:
        half = math.radians(self.config.colour_deg) / 2
        foot = np.arctan2(self.config.eye_m, np.maximum(away - radius, 1e-3)) - tilt_rad
        inside = (off <= half) & (np.abs(foot) <= half)
        return np.asarray(inside & (away <= self.config.colour_reach_m))

    def _measured_by_tof(self, index: int, disc: np.ndarray, yaw: float) -> SeenDisc:
        config = self.config
        sigmas = np.array([config.tof_along_m, config.tof_across_m])
        return self._measured(index, disc, yaw, 0.7 * sigmas, sigmas)

    def _measured_by_colour(
        self, index: int, disc: np.ndarray, yaw: float, pitch: float
    ) -> SeenDisc:
        config = self.config
        away = float(np.hypot(disc[0], disc[1]))
        slope = (away**2 + config.eye_m**2) / config.eye_m
        edge, claimed = math.radians(config.edge_deg), math.radians(config.claimed_pitch_deg)
        sigmas = slope * math.hypot(claimed, edge), away * math.radians(config.claimed_yaw_deg)
        noise = np.array([slope * edge, away * edge])
        return self._measured(index, disc, yaw, noise, np.array(sigmas), slope * pitch)

    def _measured(
        self,
        index: int,
        disc: np.ndarray,
        yaw: float,
        noise: np.ndarray,
        claimed: np.ndarray,
        farther_m: float = 0.0,
    ) -> SeenDisc:
        """The disc as a look has it: turned by the head's error, moved along and across the ray."""
        away = float(np.hypot(disc[0], disc[1]))
        ahead = disc[:2] / max(away, 1e-6)
        axes = np.stack([ahead, [-ahead[1], ahead[0]]])
        along, across = noise * self._rng.standard_normal(2)
        position = disc[:2] + axes.T @ np.array([along + farther_m, across + yaw * away])
        radius = float(disc[2]) * (1.0 + 0.05 * float(self._rng.standard_normal()))
        return SeenDisc(index, position, axes.T @ np.diag(claimed**2) @ axes, radius)
