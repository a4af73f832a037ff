"""Noise model of the walking robot's localiser: steps, gyro, and sightings that share the error of one head.

Each step slips and turns a little beyond what the joint angles report. The part that is constant within a run
is estimated as a state (see `filtering.models`); the part that is new at every step is process noise.

Source: seed 001, section 3; figures from walking trials as noted.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from ..filtering import models
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
from ..primitives.frame import StepOdometry
from ..primitives.gaussian import Gaussian
from ..primitives.landmark import Sighting
from ..primitives.pose import Pose2
from ..primitives.settings import setting
from .ukf_engines import ENGINES

SLIP_WALK_M = 0.00002  # ours: change of the mean slip per step, almost none
DRIFT_WALK_RAD = math.radians(0.005)  # ours: change of the drift per step, almost none
GYRO_BIAS_SIGMA_RADPS = 0.005  # consumer MEMS gyro, at switch-on
GYRO_BIAS_WALK_RADPS = 0.00003  # ours: per square root of a second
RANGE_WALK = 0.1  # ours: per square root of a second; other tags have another offset
NO_ODOMETRY_MPS = 0.10
"""Ours: speed of a robot that may walk on without odometry; steps have 0.08 m in 0.65 s at most."""
NO_ODOMETRY_RADPS = 0.22  # ours: likewise turn on; any rate up to that of turning steps, 0.37 rad/s


FRESH = (
    *("step_x_sigma_m", "step_y_sigma_m", "step_yaw_sigma_rad"),
    *("still_sigma_m", "still_sigma_rad", "gyro_sigma_radps"),
)
"""Settings of the noise that is new at every step."""


@dataclass(frozen=True)
class LocaliserConfig:
    """Noise of steps, gyro and head."""

    slip_m: float = setting(
        -0.0012,
        "m",
        "mean forward slip of a step",
        "ours: walking trials; the dynamic body differs",
    )
    slip_sigma_m: float = (
        0.0005  # ours: walking trials; standard deviation of the mean slip over floors
    )
    drift_sigma_rad: float = math.radians(
        0.15
    )  # ours: walking trials, -0.3 to 0.2 deg a step; standard deviation over runs of the mean turn that a step adds
    step_x_sigma_m: float = setting(
        0.0015, "m", "standard deviation of one step, forward", "ours: walking trials"
    )
    step_y_sigma_m: float = setting(
        0.0006,
        "m",
        "standard deviation of one step, lateral",
        "ours: walking trials, 0.4 to 0.8 mm",
    )
    step_yaw_sigma_rad: float = setting(
        math.radians(0.6), "rad", "standard deviation of one step, heading", "ours: walking trials"
    )
    gyro_sigma_radps: float = setting(
        0.002, "rad/s", "standard deviation of the mean rate over a frame", "consumer MEMS gyro"
    )
    rejected_frames: int = 4  # ours; mostly rejected frames in a row before the pose is reset
    lateral_slip_m: float = 0.0  # ours: mean slip of a step to the left
    lateral_slip_sigma_m: float = 0.0002  # ours: its standard deviation over runs; joint zeros
    still_sigma_m: float = 0.0003  # ours: per square root of a second, while standing
    still_sigma_rad: float = math.radians(0.02)  # ours: likewise
    pan_offset_sigma_rad: float = math.radians(0.3)  # walking trials: joint zeros, one per run
    range_offset_sigma: float = 0.7  # ours: rendered tags; common bias, in deviations of a range
    shared_bearing_sigma_rad: float = math.radians(0.4)  # walking trials: neck play, per frame
    engine: str = setting(
        "compiled",
        "",
        "runs the filter: compiled, or filterpy (the same estimates, slower, for reference)",
        "ours; Labbe, filterpy",
    )
    lag_s: float = setting(
        0.0,
        "s",
        "during a walk with landmarks, GTSAM smooths the last so many seconds for the pose; 0: the filter alone",
        "ours; Kaess et al. 2012",
    )

    def __post_init__(self) -> None:
        for name in (
            "slip_sigma_m",
            "lateral_slip_sigma_m",
            "drift_sigma_rad",
            "step_x_sigma_m",
            "step_y_sigma_m",
            "step_yaw_sigma_rad",
            "gyro_sigma_radps",
            "still_sigma_m",
            "still_sigma_rad",
            "pan_offset_sigma_rad",
            "range_offset_sigma",
        ):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(
                    f"localiser: {name}={value} must be positive; give a standard deviation"
                )
        if self.engine not in ENGINES:
            raise ConfigError(
                f"localiser: engine={self.engine!r} is unknown; choose {', '.join(ENGINES)}"
            )
        if not (self.lag_s == 0.0 or 1.0 <= self.lag_s < math.inf):
            raise ConfigError(
                f"localiser: lag_s={self.lag_s} must be 0 (no smoothing) or at least 1 s, some frames"
            )
        if self.rejected_frames < 1:
            raise ConfigError(
                f"localiser: rejected_frames={self.rejected_frames} must be at least 1"
            )

    def times(self, steps: float, sightings: float) -> LocaliserConfig:
        """The same with the standard deviations of what is new at every step, and at every sighting, times factors."""
        shared = sightings * self.shared_bearing_sigma_rad
        fresh = {name: steps * getattr(self, name) for name in FRESH}
        return replace(self, shared_bearing_sigma_rad=shared, **fresh)

    def initial_state(self, start: Gaussian) -> Gaussian:
        """The whole state at the start of a run, from a Gaussian over (x, y, yaw)."""
        mean = np.zeros(WALKER_SIZE)
        mean[:3] = start.mean
        mean[SLIP], mean[LATERAL_SLIP] = self.slip_m, self.lateral_slip_m
        variance = np.zeros(WALKER_SIZE)
        variance[SLIP], variance[LATERAL_SLIP] = self.slip_sigma_m**2, self.lateral_slip_sigma_m**2
        variance[DRIFT], variance[GYRO_BIAS] = self.drift_sigma_rad**2, GYRO_BIAS_SIGMA_RADPS**2
        variance[PAN], variance[RANGE] = self.pan_offset_sigma_rad**2, self.range_offset_sigma**2
        variance[TURN] = 1e-12
        covariance = np.diag(variance)
        covariance[:3, :3] = start.covariance
        return Gaussian(mean, models.positive(covariance))


def process_noise(
    config: LocaliserConfig, yaw: float, steps: float, dt: float, blind_s: float | None
) -> Float[np.ndarray, "10 10"]:
    """Covariance that one interval adds to the state.

    Args:
        config: Noise of steps.
        yaw: Heading, rad: slip is forward and lateral in the body frame.
        steps: Footsteps made.
        dt: Time passed, s.
        blind_s: Time without odometry before the interval, s: the robot may have walked and turned on all the while, so
            that the deviation grows with the time; None: with odometry.
    """
    if blind_s is not None:
        more = (blind_s + dt) ** 2 - blind_s**2
        along = across = NO_ODOMETRY_MPS**2 * more
        turn = NO_ODOMETRY_RADPS**2 * more
    else:
        standing_s = dt if steps == 0.0 else 0.0
        still = config.still_sigma_m**2 * standing_s
        along = config.step_x_sigma_m**2 * steps + still
        across = config.step_y_sigma_m**2 * steps + still
        turn = config.step_yaw_sigma_rad**2 * steps + config.still_sigma_rad**2 * standing_s
    turn = max(turn, 1e-12)  # without noise of the turn the covariance would be singular
    rotation = Pose2(yaw=yaw).rotation
    Q = np.zeros((WALKER_SIZE, WALKER_SIZE))
    Q[:2, :2] = rotation @ np.diag([along, across]) @ rotation.T
    Q[YAW, YAW] = Q[TURN, TURN] = Q[YAW, TURN] = Q[TURN, YAW] = turn  # one and the same turn
    Q[SLIP, SLIP] = Q[LATERAL_SLIP, LATERAL_SLIP] = SLIP_WALK_M**2 * steps
    Q[DRIFT, DRIFT] = DRIFT_WALK_RAD**2 * steps
    Q[GYRO_BIAS, GYRO_BIAS] = GYRO_BIAS_WALK_RADPS**2 * dt
    Q[PAN, PAN] = 1e-14  # a constant
    Q[RANGE, RANGE] = RANGE_WALK**2 * dt
    return Q


def linearised_motion(
    before: Gaussian, odometry: StepOdometry | None, noise: Float[np.ndarray, "10 10"]
) -> tuple[Float[np.ndarray, "10 10"], Gaussian]:
    """Jacobian of the motion model, and the state after it to first order.

    Args:
        before: State, entries as in `filtering.models`.
        odometry: As given to the filter.
        noise: Covariance that the motion adds.
    """
    blind = odometry is None or not (
        bool(np.all(np.isfinite(odometry.motion.vector))) and math.isfinite(odometry.steps)
    )
    made = Pose2() if blind or odometry is None else odometry.motion
    steps = 0.0 if blind or odometry is None else abs(odometry.steps)
    x = before.mean
    c, s = math.cos(x[YAW]), math.sin(x[YAW])
    ahead, left = made.x + x[SLIP] * steps, made.y + x[LATERAL_SLIP] * steps
    F = np.eye(WALKER_SIZE)
    F[X, YAW], F[Y, YAW] = -s * ahead - c * left, c * ahead - s * left
    F[X, SLIP], F[Y, SLIP] = c * steps, s * steps
    F[X, LATERAL_SLIP], F[Y, LATERAL_SLIP] = -s * steps, c * steps
    F[YAW, DRIFT] = F[TURN, DRIFT] = steps
    F[TURN, TURN] = 0.0
    return F, Gaussian(
        models.walk(x, 0.0, made, steps), models.positive(F @ before.covariance @ F.T + noise)
    )


def joint_noise(
    covariances: Sequence[Float[np.ndarray, "2 2"]], shared_bearing_sigma_rad: float
) -> Float[np.ndarray, "m m"]:
    """Covariance of the sightings of one frame, whose bearings share the pan error of the head.

    Args:
        covariances: k of (2, 2), of (range, bearing), each including the shared part.
        shared_bearing_sigma_rad: Standard deviation of the shared part; reduced where a bearing is more certain.

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
    """Standard deviation of the range of each sighting, m."""
    return np.sqrt(np.maximum([sighting.covariance[0, 0] for sighting in sightings], 0.0))
