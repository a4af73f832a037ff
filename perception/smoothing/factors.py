"""Measurements as factors, independent of the solver.

Poses are numbered in order of time. A factor constrains one pose or two: odometry, a sighted landmark, a
registered pose, a loop closure, a detected floor. The same factors serve the planar smoother (`Pose2`,
Gaussians over x, y, yaw) and the one in space (`Pose3`, `Placement`).

Some errors are not white: a constant slip of steps, a gyro bias, a pan offset. Such an error is a `Systematic`
with a name; factors that contain it carry an `Effect`, and the smoother estimates it with the poses.

Covariances of a motion are in the axes of the pose before it, covariances of a pose in those of the world:
(x, y, yaw) on the floor, (x, y, z, rotation vector) in space.

Source: seed 001, sections 2 and 3 (the measurements); Dellaert and Kaess, "Factor Graphs for Robot Perception"
(2017).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from ..primitives.errors import ConfigError, InputError
from ..primitives.gaussian import Gaussian
from ..primitives.plane import Plane
from ..primitives.pose import Pose2, Pose3

LOSSES = ("none", "huber", "cauchy")
WIDTHS = {"huber": 1.345, "cauchy": 2.385}  # 95 % efficiency for Gaussian errors


@dataclass(frozen=True)
class Loss:
    """Robust loss: "none" (quadratic), "huber" (linear beyond the width) or "cauchy" (logarithmic).

    Args:
        kind: One of `LOSSES`.
        width: Where it departs from the square, in standard deviations; 0 takes that of `WIDTHS`.
    """

    kind: str = "none"
    width: float = 0.0

    def __post_init__(self) -> None:
        if self.kind not in LOSSES:
            raise ConfigError(f"loss kind={self.kind!r} is unknown; choose {', '.join(LOSSES)}")
        if not (math.isfinite(self.width) and self.width >= 0.0):
            raise ConfigError(f"loss width={self.width} must be positive, or 0 for the default")


@dataclass(frozen=True)
class Systematic:
    """A constant or slowly varying error: a small motion per unit of the effects' scale.

    Args:
        name: By which effects refer to it.
        mean: (3,), prior mean of (ahead, left, turn), m, m, rad, per unit of scale.
        sigma: (3,), prior standard deviation; 0 where there is no such error.
        walk: (3,), standard deviation of its change per square root of the effects' elapsed.
    """

    name: str
    mean: Float[np.ndarray, "3"]
    sigma: Float[np.ndarray, "3"]
    walk: Float[np.ndarray, "3"]

    def __post_init__(self) -> None:
        _check(f"systematic error {self.name!r}", self.mean, self.sigma, self.walk)
        if np.any(self.sigma < 0.0) or np.any(self.walk < 0.0):
            raise ConfigError(
                f"systematic error {self.name!r}: sigma={self.sigma} and walk={self.walk} must not be negative"
            )


@dataclass(frozen=True)
class Effect:
    """The share of a systematic error in one measurement.

    Args:
        name: Of the error.
        scale: Positive; the measurement lacks the motion `scale * error` at its end.
        elapsed: Since the previous effect of the error, in the unit of its walk.
    """

    name: str
    scale: float
    elapsed: float = 0.0

    def __post_init__(self) -> None:
        if not (self.scale > 0.0 and self.elapsed >= 0.0 and math.isfinite(self.scale)):
            raise ConfigError(
                f"effect of {self.name!r}: scale={self.scale} must be positive and "
                f"elapsed={self.elapsed} not negative; leave out effects with scale 0"
            )


@dataclass(frozen=True)
class Placement:
    """A pose in space with its covariance.

    Args:
        pose: T_world_body.
        covariance: (6, 6) of (x, y, z, rotation vector), world axes, m and rad.
    """

    pose: Pose3
    covariance: Float[np.ndarray, "6 6"]

    def __post_init__(self) -> None:
        _check("placement", self.covariance, self.pose.position)


@dataclass(frozen=True)
class Motion:
    """Odometry between two poses.

    Args:
        before, after: Numbers of the two poses.
        motion: T_before_after.
        covariance: (3, 3) of (x, y, yaw) or (6, 6) of (x, y, z, rotation vector), axes of the pose before.
        effects: Its systematic errors; only on the floor.
        loss: Against slips and falls.
    """

    before: int
    after: int
    motion: Pose2 | Pose3
    covariance: Float[np.ndarray, "d d"]
    effects: tuple[Effect, ...] = ()
    loss: Loss = field(default_factory=Loss)

    def __post_init__(self) -> None:
        _check_between("motion", self.before, self.after, self.motion, self.covariance)
        if self.effects and isinstance(self.motion, Pose3):
            raise InputError(
                f"motion {self.before} to {self.after}: systematic errors are supported on the floor only; "
                "give a motion in space without effects"
            )


@dataclass(frozen=True)
class LoopClosure:
    """Relative pose of two poses at a recognised place.

    Args:
        before, after: Numbers of the two poses.
        motion: T_before_after.
        covariance: As of `Motion`.
        loss: Against false recognition; Cauchy's tolerates gross errors.
    """

    before: int
    after: int
    motion: Pose2 | Pose3
    covariance: Float[np.ndarray, "d d"]
    loss: Loss = field(default_factory=lambda: Loss("cauchy"))

    def __post_init__(self) -> None:
        _check_between("loop closure", self.before, self.after, self.motion, self.covariance)


@dataclass(frozen=True)
class PoseSeen:
    """Measured pose, by registration with a map or given from outside.

    Args:
        pose: Number of the pose.
        place: Gaussian over (x, y, yaw), or a placement in space; world frame.
        loss: Against false registration.
    """

    pose: int
    place: Gaussian | Placement
    loss: Loss = field(default_factory=Loss)

    def __post_init__(self) -> None:
        if isinstance(self.place, Gaussian):
            _check(f"pose seen at {self.pose}", self.place.mean)
            if self.place.mean.shape != (3,):
                raise InputError(
                    f"pose seen at {self.pose}: mean {self.place.mean} must be (x, y, yaw)"
                )
            check_covariance(f"pose seen at {self.pose}", self.place.covariance, 3)
        else:
            check_covariance(f"pose seen at {self.pose}", self.place.covariance, 6)


@dataclass(frozen=True)
class LandmarkSeen:
    """Sighting of one landmark, body axes.

    Args:
        landmark: Its position (x, y) in the world, m, if known, else its number.
        measured: (range on the floor in m, bearing in rad, left positive).
        covariance: (2, 2) of the two, without the errors that the whole glance shares.
        effects: Systematic errors of this sighting alone, in axes along and across the ray.
        loss: Against false identities.
    """

    landmark: tuple[float, float] | int
    measured: Float[np.ndarray, "2"]
    covariance: Float[np.ndarray, "2 2"]
    effects: tuple[Effect, ...] = ()
    loss: Loss = field(default_factory=Loss)

    def __post_init__(self) -> None:
        name = f"landmark {self.landmark} seen"
        _check(name, self.measured)
        check_covariance(name, self.covariance, 2)
        if not self.measured[0] > 0.0:
            raise InputError(
                f"{name}: range {self.measured[0]} m must be positive; leave out the sighting"
            )


@dataclass(frozen=True)
class Glance:
    """Sightings of landmarks from one pose at one instant, with common errors of the head.

    Args:
        pose: Number of the pose.
        seen: The landmarks.
        play_rad: Standard deviation of a bearing error that all of them share, independent at every glance.
        effects: Systematic errors of the head, common to all landmarks.
    """

    pose: int
    seen: tuple[LandmarkSeen, ...]
    play_rad: float = 0.0
    effects: tuple[Effect, ...] = ()

    def __post_init__(self) -> None:
        if not (math.isfinite(self.play_rad) and self.play_rad >= 0.0):
            raise InputError(
                f"glance at {self.pose}: play_rad={self.play_rad} must not be negative"
            )


@dataclass(frozen=True)
class FloorSeen:
    """Detected floor below a pose in space: it determines height, roll and pitch.

    Args:
        pose: Number of the pose.
        plane: In the axes of the pose, normal up, with its covariance; the world's floor is z = 0.
        loss: Against a table detected as floor.
    """

    pose: int
    plane: Plane
    loss: Loss = field(default_factory=lambda: Loss("huber"))

    def __post_init__(self) -> None:
        check_covariance(f"floor seen at {self.pose}", self.plane.covariance, 3)


Factor = Motion | LoopClosure | PoseSeen | Glance | FloorSeen


def poses_of(factor: Factor) -> tuple[int, ...]:
    """Numbers of the poses that a factor constrains."""
    if isinstance(factor, (Motion, LoopClosure)):
        return (factor.before, factor.after)
    return (factor.pose,)


def turned_covariance(
    covariance: Float[np.ndarray, "d d"], rotation: Float[np.ndarray, "k k"]
) -> Float[np.ndarray, "d d"]:
    """The covariance of a pose in other axes.

    Args:
        covariance: (3, 3) of (x, y, yaw) or (6, 6) of (x, y, z, rotation vector).
        rotation: (2, 2) or (3, 3), from the old axes to the new.
    """
    turn = np.eye(len(covariance))
    k = len(rotation)
    turn[:k, :k] = rotation
    if k == 3:
        turn[3:, 3:] = rotation
    return np.asarray(turn @ covariance @ turn.T)


def check_covariance(name: str, covariance: Float[np.ndarray, "d d"], size: int) -> None:
    """Refuse matrices that are not finite, symmetric and positive definite of this size."""
    if covariance.shape != (size, size):
        raise InputError(f"{name}: covariance of {covariance.shape}, expected ({size}, {size})")
    good = bool(np.all(np.isfinite(covariance)))
    good = good and bool(np.allclose(covariance, covariance.T, rtol=1e-6, atol=1e-15))
    if good:
        try:
            np.linalg.cholesky(covariance)
        except np.linalg.LinAlgError:
            good = False
    if not good:
        raise InputError(
            f"{name}: covariance {covariance.tolist()} must be finite, symmetric and positive definite; "
            "give every direction a standard deviation"
        )


def _check_between(
    name: str, before: int, after: int, motion: Pose2 | Pose3, covariance: Float[np.ndarray, "d d"]
) -> None:
    name = f"{name} {before} to {after}"
    if before == after:
        raise InputError(f"{name}: the two poses must be different ones")
    _check(name, motion.vector if isinstance(motion, Pose2) else motion.position)
    check_covariance(name, covariance, 3 if isinstance(motion, Pose2) else 6)


def _check(name: str, *arrays: np.ndarray) -> None:
    for array in arrays:
        if not np.all(np.isfinite(array)):
            raise InputError(f"{name}: {array} must be finite; leave out the measurement")
