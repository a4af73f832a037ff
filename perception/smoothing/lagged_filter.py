"""The pose of a walking robot by fixed-lag smoothing during the walk: an option in place of the filter's.

The smoother estimates the last seconds anew at every frame, with robust losses for landmarks; the pose is that of the
newest frame. The filter runs beside it and reports the innovations; both have the noise that it learns. Whenever its state
is set, by scan registration or because it was lost, the smoother begins anew from its pose: with registration the two are
therefore the same. So it does after `MOST_FRAMES`, so that its memory is bounded.

The newest pose is no better than the filter's (30 simulated walks: 12.3 and 11.9 mm, 0.92 and 0.88 deg; both consistent):
what later measurements bring is in the older poses, which `surefoot process --smooth` gives.

Source: seed 001, section 3 (measurements); Kaess et al. 2012 (iSAM2).
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from ..localisation.filter import PoseFilter, UpdateReport
from ..localisation.localiser_noise import LocaliserConfig
from ..primitives.errors import InputError
from ..primitives.frame import Imu, StepOdometry
from ..primitives.gaussian import Gaussian
from ..primitives.landmark import Landmark, Sighting
from ..primitives.pose import Pose2
from .factors import Factor
from .fixed_lag import FixedLagSmoother
from .smoother import SmootherConfig
from .walk_factors import glance, step, walk_systematics

log = logging.getLogger(__name__)

MOST_FRAMES = 3000  # ours: after which the smoother begins anew; a checkpoint of them has 2 MB and is read in 15 s


class LaggedFilter(PoseFilter):
    """A pose filter whose pose is the newest one of a smoother over the last `config.lag_s` seconds."""

    def __init__(
        self, start: Gaussian, landmarks: Sequence[Landmark], config: LocaliserConfig
    ) -> None:
        """Begin at a pose; arguments as of `PoseFilter`."""
        super().__init__(start, landmarks, config)
        self._seen_s = 0.0
        self._places = {mark.identity: mark.position[:2] for mark in landmarks}
        self._begin()

    @property
    def pose(self) -> Gaussian:
        """Gaussian over (x, y, yaw) of the newest frame, m and rad, world frame."""
        return self._newest

    @property
    def pose2(self) -> Pose2:
        """The mean pose."""
        return Pose2(*(float(v) for v in self._newest.mean))

    def set_state(self, state: Gaussian) -> None:
        """Replace the filter's state; the smoother begins anew."""
        super().set_state(state)
        self._begin()

    def predict(self, odometry: StepOdometry | None, imu: Imu | None, dt: float) -> None:
        """Advance to the next frame; arguments as of `PoseFilter`."""
        blind_s, noise = self._blind_s or 0.0, self.noise  # as the filter takes them
        super().predict(odometry, imu, dt)
        dt = max(dt, 0.0) if math.isfinite(dt) else 0.0
        if odometry is None and dt == 0.0:  # the first frame is the start
            return
        if self._factors:  # of a lost frame, which had no sightings
            self._smooth()
        if len(self._given) > MOST_FRAMES:
            self._begin()
            return
        self._stamp_s += dt
        self._number += 1
        self._factors: list[Factor] = [step(noise, self._number, odometry, imu, dt, blind_s)]

    def update(self, sightings: Sequence[Sighting]) -> UpdateReport:
        """Update filter and smoother with the landmarks of one frame; the report is the filter's."""
        since, noise, factor = self._given, self.noise, self._sightings_factor.value
        report = super().update(sightings)
        if self._given is not since:  # begun anew from a pose that knows these sightings
            return report
        elapsed = self._stamp_s - self._seen_s
        scaled = [replace(one, covariance=factor**2 * one.covariance) for one in sightings]
        seen = glance(noise, self._number, scaled, self._places, elapsed)
        if seen is not None:
            self._seen_s = self._stamp_s
            self._factors.append(seen)
        if self._factors:
            self._smooth()
        return report

    def _begin(self) -> None:
        """A new smoother; its pose 0 is the filter's pose."""
        self._start = self._newest = super().pose
        self._number, self._stamp_s, self._seen_s = 0, 0.0, 0.0
        self._factors = []
        self._given: list[tuple[float, list[Factor]]] = [(0.0, [])]
        self._smoother = self._restored()

    def _smooth(self) -> None:
        """Take the factors of this frame; from the filter's pose where they determine none."""
        self._given.append((self._stamp_s, self._factors))
        try:
            self._smoother.update(*self._given[-1])
            newest = self._smoother.pose(self._number)
        except InputError as error:
            log.warning("%s; smoothing begins anew", error)
            self._begin()
            return
        assert isinstance(newest, Gaussian)
        self._newest, self._factors = newest, []

    def _restored(self) -> FixedLagSmoother:
        """The smoother after all that it was given; a checkpoint keeps that, since GTSAM's objects are no values."""
        config = SmootherConfig(lag_s=self.config.lag_s)
        smoother = FixedLagSmoother(self._start, walk_systematics(self.config), config)
        for stamp, factors in self._given:
            smoother.update(stamp, factors)
        return smoother

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "_smoother"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._smoother = self._restored()
