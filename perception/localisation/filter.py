"""Where am I: a sigma-point filter on step odometry, gyro and landmarks.

Steps slip and turn a little more than the joints tell, by an amount that is the same over a run and one
that is new at every step; so does the head err. The first is estimated (see `models`), the second is noise. The gyro is
taken as a measurement of the turn made since the frame before. Landmarks seen in one frame are used
together, because they share the error of the one head that saw them.

The sigma points are those of `engines`; here are the noise, the gate, and what keeps it alive.

Source: seed 001, section 3, eq. (2) (sigma-point filter); noise figures from walking trials.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..filtering import models
from ..filtering.consistency import Innovation, chi_square_quantile
from ..filtering.models import (
    DRIFT,
    GYRO_BIAS,
    LATERAL_SLIP,
    PAN,
    RANGE,
    SLIP,
    TURN,
    WALKER_SIZE,
    YAW,
    X,
    Y,
)
from ..primitives.errors import ConfigError
from ..primitives.frame import Imu, StepOdometry
from ..primitives.gaussian import Gaussian
from ..primitives.landmark import Landmark, Sighting
from ..primitives.pose import Pose2
from .relocation import pose_from_sightings
from .ukf_backends import ENGINES, engine

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class LocaliserConfig:
    """Noise of walking, of the gyro and of shared head angles; gate and recovery."""

    slip_m: float = -0.0012  # walking trials: mean forward slip of a step
    slip_sigma_m: float = 0.0005  # ours: how far a floor's mean slip may lie from that
    crab_m: float = 0.0  # ours: mean slip of a step to the left
    crab_sigma_m: float = 0.0002  # ours: how far a run's may lie from that; joint zeros
    drift_sigma_rad: float = math.radians(0.15)  # walking trials: -0.3 to 0.2 deg a step, per run
    step_x_sigma_m: float = 0.0015  # walking trials, per step
    step_y_sigma_m: float = 0.0006  # walking trials: 0.4 to 0.8 mm
    step_yaw_sigma_rad: float = math.radians(0.6)  # walking trials
    slip_walk_m: float = 0.00002  # ours: change of the mean slip per step, nearly none
    drift_walk_rad: float = math.radians(0.005)  # ours: change of the drift per step, nearly none
    gyro_sigma_radps: float = 0.002  # of the mean over one interval; consumer MEMS gyro
    gyro_bias_sigma_radps: float = 0.005  # consumer MEMS gyro, at switch-on
    range_walk: float = 0.1  # ours: per square root of a second; other tags, other offset
    gyro_bias_walk_radps: float = 0.00003  # ours: per square root of a second
    still_sigma_m: float = 0.0003  # ours: per square root of a second, while standing
    still_sigma_rad: float = math.radians(0.02)  # ours: likewise
    blind_sigma_m: float = 0.07  # ours: per square root of a second without odometry, cruise speed
    blind_sigma_rad: float = 0.4  # ours: likewise, about one turning step
    pan_offset_sigma_rad: float = math.radians(0.3)  # walking trials: joint zeros, one a run
    range_offset_sigma: float = (
        0.7  # ours: rendered tags; share of a range's deviation common to all
    )
    shared_bearing_sigma_rad: float = math.radians(
        0.4
    )  # walking trials: neck play, same for a frame
    gate_probability: float = 0.999  # ours: true sightings kept
    rejected_frames: int = 4  # ours: frames in a row, mostly rejected, before doubting oneself
    doubt_m: float = 0.15  # ours: deviation added to the position then
    doubt_rad: float = math.radians(8.0)  # ours: and to the heading
    engine: str = "compiled"  # or "filterpy": the same numbers, slower, to be read

    def __post_init__(self) -> None:
        for name in (
            "slip_sigma_m",
            "crab_sigma_m",
            "drift_sigma_rad",
            "step_x_sigma_m",
            "step_y_sigma_m",
            "step_yaw_sigma_rad",
            "gyro_sigma_radps",
            "gyro_bias_sigma_radps",
            "still_sigma_m",
            "still_sigma_rad",
            "blind_sigma_m",
            "blind_sigma_rad",
            "pan_offset_sigma_rad",
            "range_offset_sigma",
        ):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"localiser: {name}={value} must be positive; give a deviation")
        if not 0.0 < self.gate_probability < 1.0:
            raise ConfigError(
                f"localiser: gate_probability={self.gate_probability} must lie between 0 and 1"
            )
        if self.engine not in ENGINES:
            raise ConfigError(
                f"localiser: engine={self.engine!r} is unknown; choose one of {ENGINES}"
            )
        if self.rejected_frames < 1:
            raise ConfigError(
                f"localiser: rejected_frames={self.rejected_frames} must be at least 1"
            )


@dataclass(frozen=True)
class UpdateReport:
    """What became of the sightings of one frame.

    Args:
        accepted: How many were used.
        rejected: How many were not: unknown, ambiguous, not finite, or outside the gate.
        innovations: Of every sighting whose landmark was told, used or not.
    """

    accepted: int
    rejected: int
    innovations: list[Innovation]

    @property
    def nis(self) -> list[float]:
        """Normalised innovation squared of each, chi-square with two degrees of freedom if consistent."""
        return [innovation.nis for innovation in self.innovations]


class PoseFilter:
    """The robot's pose on the floor with its covariance; advances by `predict`, learns by `update`."""

    def __init__(
        self, start: Gaussian, landmarks: Sequence[Landmark], config: LocaliserConfig | None = None
    ) -> None:
        """Begin at a pose.

        Args:
            start: Over (x, y, yaw), m and rad, world frame.
            landmarks: Those that may be sighted.
            config: Noise figures; the defaults if None.
        """
        if start.mean.shape != (3,) or not np.all(np.isfinite(start.mean)):
            raise ConfigError(f"localiser: start {start.mean} must be a finite (x, y, yaw)")
        self.config = config or LocaliserConfig()
        self._places = {mark.identity: np.array(mark.position[:2]) for mark in landmarks}
        self._gate = chi_square_quantile(self.config.gate_probability, 2)
        self._frames_rejected = 0
        self._engine = engine(self.config.engine, _first_belief(start, self.config))

    @property
    def pose(self) -> Gaussian:
        """Over (x, y, yaw), m and rad, world frame; the yaw in [-pi, pi)."""
        belief = self._engine.belief
        return Gaussian(belief.mean[:3], belief.covariance[:3, :3].copy())

    @property
    def pose2(self) -> Pose2:
        """The mean."""
        x, y, yaw = (float(v) for v in self._engine.belief.mean[:3])
        return Pose2(x, y, yaw)

    @property
    def state(self) -> Gaussian:
        """The whole state, entries as in `models`."""
        return self._engine.belief

    def believe(self, state: Gaussian) -> None:
        """Take over a whole state that was conditioned outside (`registration`), entries as in `models`."""
        self._engine.reset(state)

    def predict(self, odometry: StepOdometry | None, imu: Imu | None, dt: float) -> None:
        """Advance to the next frame.

        Args:
            odometry: Motion since the frame before; None or not finite: the robot may have walked anywhere.
            imu: Means over that time; None or not finite: no gyro.
            dt: That time, s, not negative.
        """
        if odometry is not None and not _finite(odometry.motion.vector, odometry.steps):
            log.warning("step odometry %s is not finite and is not used", odometry)
            odometry = None
        dt = max(dt, 0.0) if math.isfinite(dt) else 0.0
        motion = odometry.motion if odometry else Pose2()
        steps = abs(odometry.steps) if odometry else 0.0
        yaw = float(self._engine.belief.mean[YAW])
        noise = process_noise(self.config, yaw, steps, dt, blind=odometry is None)
        self._engine.walk(motion, steps, noise)
        if imu is not None and dt > 0.0 and _finite(imu.angular_velocity, 0.0):
            turn = float(imu.angular_velocity[2]) * dt
            self._engine.turned(turn, self.config.gyro_sigma_radps * dt, dt)

    def update(self, sightings: Sequence[Sighting]) -> UpdateReport:
        """Learn from the landmarks of one frame, all at once.

        A sighting without identity is given to the only known landmark inside the gate, if there is
        just one. When several frames in a row are mostly unacceptable, the filter doubts itself: it takes
        the pose that two sightings agree on, or else its covariance grows until some are accepted again.
        """
        accepted: list[tuple[Sighting, np.ndarray]] = []
        innovations: list[Innovation] = []
        for sighting in sightings:
            place, innovation = self._recognise(sighting)
            if innovation is not None:
                innovations.append(innovation)
            if place is not None:
                accepted.append((sighting, place))
        if accepted:
            self._learn(accepted)
        if 2 * len(accepted) > len(innovations):
            self._frames_rejected = 0
        elif innovations:
            self._doubt(sightings)
        return UpdateReport(len(accepted), len(sightings) - len(accepted), innovations)

    def _recognise(self, sighting: Sighting) -> tuple[np.ndarray | None, Innovation | None]:
        """The place of the landmark, None if not acceptable, and the innovation, None if not told."""
        if not _is_finite(sighting):
            return None, None
        if sighting.identity is not None:
            place = self._places.get(sighting.identity)
            if place is None:
                return None, None
            innovation = self._innovation(sighting, place)
            return (place if innovation.nis <= self._gate else None), innovation
        near = [
            (place, innovation)
            for place in self._places.values()
            if (innovation := self._innovation(sighting, place)).nis <= self._gate
        ]
        return near[0] if len(near) == 1 else (None, None)

    def _innovation(self, sighting: Sighting, place: np.ndarray) -> Innovation:
        """Of one sighting, if it were of the landmark at this place."""
        (sigma_m,) = range_sigmas([sighting]).tolist()
        expected = self._engine.expected(place, sigma_m)
        difference = models.sighting_difference(sighting.measured, expected.mean)
        covariance = models.positive(expected.covariance + sighting.covariance)
        return Innovation.of(sighting.identity, difference, covariance)

    def _learn(self, accepted: list[tuple[Sighting, np.ndarray]]) -> None:
        measured = np.concatenate([sighting.measured for sighting, _ in accepted])
        places = np.array([place for _, place in accepted])
        noise = joint_noise(
            [sighting.covariance for sighting, _ in accepted], self.config.shared_bearing_sigma_rad
        )
        sigmas = range_sigmas([sighting for sighting, _ in accepted])
        self._engine.learn(measured, noise, places, sigmas)

    def _doubt(self, sightings: Sequence[Sighting]) -> None:
        self._frames_rejected += 1
        if self._frames_rejected < self.config.rejected_frames:
            return
        told = [s for s in sightings if s.identity in self._places and _is_finite(s)]
        elsewhere = None
        if len(told) >= 2:
            elsewhere = pose_from_sightings(
                told,
                np.array([self._places[s.identity] for s in told if s.identity is not None]),
                joint_noise([s.covariance for s in told], self.config.shared_bearing_sigma_rad),
            )
        belief = self._engine.belief
        mean, P = belief.mean, belief.covariance
        if elsewhere is not None:
            log.info("carried elsewhere: pose taken from %d landmarks of one frame", len(told))
            self._frames_rejected = 0
            mean[:3] = elsewhere.mean
            P[:3, :] = P[:, :3] = 0.0
            P[:3, :3] = elsewhere.covariance
        else:
            log.info("%d frames mostly rejected: covariance widened", self._frames_rejected)
            P[[X, Y], [X, Y]] += self.config.doubt_m**2
            P[YAW, YAW] += self.config.doubt_rad**2
        self._engine.reset(Gaussian(mean, P))


def process_noise(
    config: LocaliserConfig, yaw: float, steps: float, dt: float, blind: bool
) -> Float[np.ndarray, "10 10"]:
    """Covariance that one interval adds to the walker's state.

    Args:
        config: Noise figures.
        yaw: Heading, rad: slip lies along and across the body.
        steps: Footsteps made.
        dt: Time passed, s.
        blind: No odometry: the robot may have walked.
    """
    if blind:
        along = across = config.blind_sigma_m**2 * dt
        turn = config.blind_sigma_rad**2 * dt
    else:
        standing_s = dt if steps == 0.0 else 0.0
        still = config.still_sigma_m**2 * standing_s
        along = config.step_x_sigma_m**2 * steps + still
        across = config.step_y_sigma_m**2 * steps + still
        turn = config.step_yaw_sigma_rad**2 * steps + config.still_sigma_rad**2 * standing_s
    turn = max(turn, 1e-12)  # a turn known exactly would make the covariance singular
    rotation = Pose2(yaw=yaw).rotation
    Q = np.zeros((WALKER_SIZE, WALKER_SIZE))
    Q[:2, :2] = rotation @ np.diag([along, across]) @ rotation.T
    Q[YAW, YAW] = Q[TURN, TURN] = Q[YAW, TURN] = Q[TURN, YAW] = turn  # one and the same turn
    Q[SLIP, SLIP] = Q[LATERAL_SLIP, LATERAL_SLIP] = config.slip_walk_m**2 * steps
    Q[DRIFT, DRIFT] = config.drift_walk_rad**2 * steps
    Q[GYRO_BIAS, GYRO_BIAS] = config.gyro_bias_walk_radps**2 * dt
    Q[PAN, PAN] = 1e-14  # a constant
    Q[RANGE, RANGE] = config.range_walk**2 * dt
    return Q


def joint_noise(
    covariances: Sequence[Float[np.ndarray, "2 2"]], shared_bearing_sigma_rad: float
) -> Float[np.ndarray, "m m"]:
    """Covariance of several sightings of one frame: their bearings share the error of the head's pan.

    Args:
        covariances: k of (2, 2), of (range, bearing), each with the shared part inside.
        shared_bearing_sigma_rad: Deviation of the shared part; taken smaller where a bearing is surer.

    Returns:
        (2 k, 2 k), positive definite.
    """
    k = len(covariances)
    R = np.zeros((2 * k, 2 * k))
    for i, covariance in enumerate(covariances):
        R[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = models.positive(covariance)
    own = min(
        R[2 * i + 1, 2 * i + 1] - R[2 * i, 2 * i + 1] ** 2 / R[2 * i, 2 * i] for i in range(k)
    )
    shared = min(shared_bearing_sigma_rad**2, 0.99 * own)  # each block minus it stays positive
    bearings = np.arange(k) * 2 + 1
    across = np.ix_(bearings, bearings)
    R[across] += shared * (1.0 - np.eye(k))
    return R


def range_sigmas(sightings: Sequence[Sighting]) -> Float[np.ndarray, "k"]:
    """Deviation claimed for the range of each sighting, m."""
    return np.sqrt(np.maximum([sighting.covariance[0, 0] for sighting in sightings], 0.0))


def _first_belief(start: Gaussian, config: LocaliserConfig) -> Gaussian:
    """The whole state at the start, from a pose."""
    mean = np.zeros(WALKER_SIZE)
    mean[:3] = start.mean
    mean[SLIP], mean[LATERAL_SLIP] = config.slip_m, config.crab_m
    covariance = np.diag(
        [
            0.0,
            0.0,
            0.0,
            config.slip_sigma_m**2,
            config.crab_sigma_m**2,
            config.drift_sigma_rad**2,
            config.gyro_bias_sigma_radps**2,
            config.pan_offset_sigma_rad**2,
            config.range_offset_sigma**2,
            1e-12,
        ]
    )
    covariance[:3, :3] = start.covariance
    return Gaussian(mean, models.positive(covariance))


def _finite(array: np.ndarray, number: float) -> bool:
    return bool(np.all(np.isfinite(array))) and math.isfinite(number)


def _is_finite(sighting: Sighting) -> bool:
    return _finite(sighting.measured, float(np.sum(sighting.covariance)))
