"""Tracks of obstacles from detections."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from perception.obstacles.track import RADIUS_SIGMA_M, Detection
from perception.obstacles.tracker import ObstacleTracker, TrackerConfig, Visible
from perception.primitives.errors import InputError
from perception.primitives.gaussian import Gaussian
from perception.primitives.obstacle import Obstacle

from . import checks
from .checks import ArrayLike


class Tracker:
    """Tracks obstacles by one UKF each: detections in, positions and velocities with covariances out.

    Source: seed 001, sections 2 and 14; data association and the evidence of motion are ours.
    """

    def __init__(
        self,
        speed_sigma_mps: float = 0.075,
        motion_model: str | type = "switching",
        **settings: Any,
    ) -> None:
        """Begin without tracks.

        Args:
            speed_sigma_mps: Standard deviation of an obstacle's speed along each axis, m/s: about 0.075 for
                small robots, 0.7 for people. It also sets how often a mover is expected to turn: every 6 m or so,
                until its own turns are known.
            motion_model: "switching" (stands, straight, curving, turned), "package.module:Class", or a
                class of your own (see `surefoot.MotionModel`).
            settings: Fields of `perception.obstacles.tracker.TrackerConfig`: `hits_to_show` detections before
                a track is reported (3), `misses_to_die` frames without detection, though `visible` (5), `max_radius_m`
                (0.35), `oldest_s` without detection (20) and `largest_sigma_m` of the position (0.8).

        Raises:
            InputError: A setting is unknown or impossible.
        """
        config = checks.configured(
            TrackerConfig,
            {"motion_model": checks.plugin(motion_model, "motion_model"), **settings},
            "Tracker",
        )
        speed = checks.positive(speed_sigma_mps, "speed_sigma_mps")
        track = dataclasses.replace(config.track, speed_sigma_mps=speed)
        self._config = dataclasses.replace(config, track=track)
        self._tracker = ObstacleTracker(self._config)
        self._stamp_s: float | None = None

    @property
    def obstacles(self) -> list[Obstacle]:
        """The reported tracks, world frame, in order of their numbers."""
        return self._tracker.obstacles

    def update(
        self,
        stamp_s: float,
        positions: ArrayLike,
        covariances: ArrayLike,
        radii_m: ArrayLike = 0.1,
        pose: Gaussian | None = None,
        radius_sigma_m: float | None = None,
        visible: Visible | None = None,
    ) -> list[Obstacle]:
        """Advance to this time and take in the detections.

        Args:
            stamp_s: Time, s; larger than at the previous call.
            positions: (n, 2), detections in the body frame (x ahead, y left), m; an empty list for none.
            covariances: (n, 2, 2), or (2, 2) for all, of the positions by the sensor alone, m^2.
            radii_m: One number or (n,), m.
            pose: Gaussian over the body's (x, y, yaw) in the world, m and rad; None: the sensor stands at the
                origin, and body frame and world frame are one.
            radius_sigma_m: Standard deviation of the radius between two detections of one obstacle, m: another
                size is another obstacle. Where a person is seen by one leg or by two, about 0.1. None: no smaller
                than that of the position where it is sharpest, and than 0.012.
            visible: Function from places (n, 2), world frame, m, to booleans (n,): which of them the sensor saw in
                this frame, in its field of view and unblocked. Without it tracks of strays and of what has left
                stay until their position is too uncertain.

        Returns:
            Tracks: `position`, `velocity`, `state` (Gaussian over x, y, vx, vy), `moving` (probability),
            `track` (its number), `radius_m`, `seen_s`; world frame.

        Raises:
            InputError: An array has the wrong shape, also that of `visible`, the time does not advance, or a
                radius exceeds `max_radius_m`.
        """
        stamp = checks.number(stamp_s, "stamp_s")
        if self._stamp_s is not None and stamp <= self._stamp_s:
            raise InputError(f"stamp_s={stamp} does not follow {self._stamp_s}")
        places = checks.numbers(positions, (None, 2), "positions")
        count = len(places)
        spreads = checks.covariances(covariances, (count, 2, 2), "covariances", shared=True)
        radii = checks.radii(radii_m, count)
        most = self._config.max_radius_m
        if (radii > most).any():
            raise InputError(
                f"radii_m must lie in [0, {most}]; set max_radius_m for larger obstacles"
            )
        robot = Gaussian(np.zeros(3), np.zeros((3, 3)))
        if pose is not None:
            robot = checks.instance(pose, Gaussian, "pose")
            checks.covariances(robot.covariance, (3, 3), "pose.covariance")
        if radius_sigma_m is None:
            # from the same points as the place, so known no better
            sigmas = np.hypot(RADIUS_SIGMA_M, np.sqrt(np.linalg.eigvalsh(spreads)[:, 0].clip(0.0)))
        else:
            sigmas = np.full(count, checks.positive(radius_sigma_m, "radius_sigma_m"))
        seen = [
            Detection(place, spread, float(radius), radius_sigma_m=float(sigma))
            for place, spread, radius, sigma in zip(places, spreads, radii, sigmas, strict=True)
        ]
        self._tracker.update(stamp, seen, robot, None if visible is None else _checked(visible))
        self._stamp_s = stamp
        return self.obstacles


def _checked(visible: Visible) -> Visible:
    """The user's function, whose answer is refused unless it is one boolean for every place."""

    def answer(places: Float[np.ndarray, "n 2"]) -> Bool[np.ndarray, "n"]:
        found = np.asarray(visible(places))
        if found.shape != (len(places),) or found.dtype != np.bool_:
            raise InputError(
                f"visible returned {found.dtype} of shape {found.shape} for {len(places)} places; expected booleans "
                f"of shape ({len(places)},)"
            )
        return found

    return answer
