"""The sensors of a walking robot as factors: footsteps, gyro, tags, and their systematic errors.

Noise and systematic errors are those of the pose filter: the slip of every step, the drift of the heading, the
gyro bias, the pan offset of the head, and the common bias of all ranges. So filter and smoother have the same
model and differ only in the measurements they use.

Poses are frames: pose 0 is the first frame, pose k is reached by the motion of frame k.

Source: seed 001, section 3; noise: see `localisation.localiser_noise`.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..filtering.models import YAW, positive
from ..localisation.localiser_noise import (
    DRIFT_WALK_RAD,
    GYRO_BIAS_SIGMA_RADPS,
    GYRO_BIAS_WALK_RADPS,
    RANGE_WALK,
    SLIP_WALK_M,
    LocaliserConfig,
    process_noise,
)
from ..primitives.frame import Imu, StepOdometry
from ..primitives.landmark import Sighting
from ..primitives.pose import Pose2, wrap_angle
from .factors import Effect, Factor, Glance, LandmarkSeen, Loss, Motion, Systematic

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Instant:
    """The localisation measurements of one frame.

    Args:
        stamp_s: Of the frame.
        odometry: Motion since the previous frame; None: the robot may have walked.
        imu: Means over that time; None without one.
        sightings: Of landmarks.
    """

    stamp_s: float
    odometry: StepOdometry | None = None
    imu: Imu | None = None
    sightings: Sequence[Sighting] = ()


SLIP, DRIFT, GYRO, PAN, RANGE = "slip", "drift", "gyro", "pan", "range"
TAG_LOSS = Loss("cauchy")  # ours: a misread tag is misread several times in a row


def walk_systematics(config: LocaliserConfig) -> tuple[Systematic, ...]:
    """The systematic errors as motions: per step, per step, per s, per glance, per standard deviation of a range."""
    none = np.zeros(3)

    def turn(sigma: float) -> np.ndarray:
        return np.array([0.0, 0.0, sigma])

    def ahead(sigma: float) -> np.ndarray:
        return np.array([sigma, 0.0, 0.0])

    return (
        Systematic(
            SLIP,
            np.array([config.slip_m, config.lateral_slip_m, 0.0]),
            np.array([config.slip_sigma_m, config.lateral_slip_sigma_m, 0.0]),
            np.array([SLIP_WALK_M, SLIP_WALK_M, 0.0]),
        ),
        Systematic(DRIFT, none, turn(config.drift_sigma_rad), turn(DRIFT_WALK_RAD)),
        Systematic(GYRO, none, turn(GYRO_BIAS_SIGMA_RADPS), turn(GYRO_BIAS_WALK_RADPS)),
        Systematic(PAN, none, turn(config.pan_offset_sigma_rad), none),
        Systematic(RANGE, none, ahead(config.range_offset_sigma), ahead(RANGE_WALK)),
    )


def walk_factors(
    instants: Sequence[Instant],
    places: Mapping[int, tuple[float, float]],
    config: LocaliserConfig | None = None,
) -> list[tuple[float, list[Factor]]]:
    """A whole walk as factors: pose k is that of frame k; frame 0 has no motion.

    Args:
        instants: In order of time.
        places: Positions of landmarks, world frame, m, by identity.
        config: Noise; the defaults if None.

    Returns:
        (stamp, factors) of every frame, for `smooth_fixed_lag`; all factors together for `smooth`.
    """
    config = config or LocaliserConfig()
    frames: list[tuple[float, list[Factor]]] = []
    last_s, blind_s = None, 0.0
    for number, instant in enumerate(instants):
        factors: list[Factor] = []
        if number > 0:
            dt = instant.stamp_s - instants[number - 1].stamp_s
            factors.append(step(config, number, instant.odometry, instant.imu, dt, blind_s))
            blind_s = blind_s + max(dt, 0.0) if instant.odometry is None else 0.0
        elapsed = 0.0 if last_s is None else instant.stamp_s - last_s
        seen = glance(config, number, instant.sightings, places, elapsed)
        if seen is not None:
            factors.append(seen)
            last_s = instant.stamp_s
        frames.append((instant.stamp_s, factors))
    return frames


def step(
    config: LocaliserConfig,
    number: int,
    odometry: StepOdometry | None,
    imu: Imu | None,
    dt: float,
    blind_s: float = 0.0,
) -> Motion:
    """The motion from pose number - 1 to pose `number`, by legs and gyro together.

    The two turns are weighted by their variances; almost all the weight is the gyro's, and then its bias is the
    systematic error of the turn.

    Args:
        config: Noise.
        number: Of the pose that the motion leads to.
        odometry: Motion since the previous frame; None or not finite: the robot may have walked.
        imu: Means over that time; None or not finite: no gyro.
        dt: That time, s, not negative.
        blind_s: Time without odometry before it, s.
    """
    if odometry is not None and not np.all(np.isfinite([*odometry.motion.vector, odometry.steps])):
        log.warning("step odometry %s is not finite and is not used", odometry)
        odometry = None
    motion = odometry.motion if odometry else Pose2()
    steps = abs(odometry.steps) if odometry else 0.0
    dt = max(dt, 0.0) if math.isfinite(dt) else 0.0
    blind = blind_s if odometry is None else None
    noise = process_noise(config, 0.0, steps, max(dt, 1e-3), blind)[:3, :3]
    effects = []
    if steps > 0.0:
        effects.append(Effect(SLIP, steps, steps))
    gyro = imu is not None and dt > 0.0 and bool(np.all(np.isfinite(imu.angular_velocity)))
    if gyro and imu is not None:
        variance = (config.gyro_sigma_radps * dt) ** 2
        share = noise[YAW, YAW] / (noise[YAW, YAW] + variance)  # of the gyro in the turn
        rest = wrap_angle(float(imu.angular_velocity[2]) * dt - motion.yaw)
        motion = Pose2(motion.x, motion.y, wrap_angle(motion.yaw + share * rest))
        drifted = ((1.0 - share) * config.drift_sigma_rad * steps) ** 2
        noise[YAW, YAW] = share * variance + drifted
        effects.append(Effect(GYRO, share * dt, dt))
    elif steps > 0.0:
        effects.append(Effect(DRIFT, steps, steps))
    return Motion(number - 1, number, motion, noise, tuple(effects))


def glance(
    config: LocaliserConfig,
    number: int,
    sightings: Sequence[Sighting],
    places: Mapping[int, tuple[float, float]],
    elapsed_s: float = 0.0,
) -> Glance | None:
    """The landmarks of one frame, or None without valid sightings.

    Args:
        config: Noise.
        number: Of the pose.
        sightings: Those without identity, unknown or not finite are ignored.
        places: Positions of landmarks, world frame, m, by identity.
        elapsed_s: Since the previous glance.
    """
    valid: list[tuple[int, np.ndarray, np.ndarray]] = []
    for one in sightings:
        numbers = np.append(one.measured, one.covariance.ravel())
        if one.identity is None or one.identity not in places:
            continue
        if np.all(np.isfinite(numbers)) and one.measured[0] > 0.0:
            valid.append((one.identity, one.measured, positive(one.covariance)))
    if not valid:
        return None
    own = min(P[1, 1] - P[0, 1] ** 2 / P[0, 0] for _, _, P in valid)
    shared = min(config.shared_bearing_sigma_rad**2, 0.99 * own)  # each must keep some of its own
    seen: list[LandmarkSeen] = []
    for identity, measured, P in valid:
        P = P - np.diag([0.0, shared])
        common = Effect(RANGE, math.sqrt(P[0, 0]), 0.0 if seen else elapsed_s)
        seen.append(LandmarkSeen(places[identity], measured, P, (common,), TAG_LOSS))
    return Glance(number, tuple(seen), math.sqrt(shared), (Effect(PAN, 1.0),))
