"""The pose from the landmarks of one frame alone, without a prior.

Two sightings of known landmarks determine a pose on the floor with one number to spare, so they can
contradict each other; then there is no result. A rigid alignment in the plane gives the initial value, and
least squares with the covariance of the sightings refines it. Landmarks that stand close together and far away leave the
pose anywhere on an arc, or turned round: that is no Gaussian, and there is no result either.

With one number to spare, also two wrong sightings may agree by chance. `RecentSightings` keeps those of the last frames, to
tell whether they confirm such a pose.

Source: alignment after Umeyama (1991), in the plane; consensus after Fischler and Bolles (1981); their use after a kidnapping
is ours.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from ..filtering.consistency import chi_square_quantile
from ..filtering.models import range_bearing, sighting_difference, symmetric, wrap_angles
from ..primitives.gaussian import Gaussian
from ..primitives.landmark import Sighting
from ..primitives.pose import Pose2

GATE_PROBABILITY = 0.999  # ours: share of correct pairs that pass the test for contradictions
REMEMBERED = 8  # ours: frames with sightings that a pose found anew is held against
STRAIGHT = 1.5  # ours: cost two deviations away, relative to that of a Gaussian, beyond which the pose is on an arc


def pose_from_sightings(
    sightings: Sequence[Sighting],
    positions: Float[np.ndarray, "k 2"],
    noise: Float[np.ndarray, "m m"],
) -> Gaussian | None:
    """The pose from which landmarks are seen as measured.

    Args:
        sightings: k of them, in one frame.
        positions: Of their landmarks, (k, 2), world frame, m.
        noise: (2 k, 2 k) covariance of (range, bearing, ...).

    Returns:
        Gaussian over (x, y, yaw), m and rad, world frame; None for fewer than two landmarks, two at one position or so
        close that the pose is not Gaussian, or contradicting sightings.
    """
    if len(sightings) < 2 or float(np.ptp(positions, axis=0).max()) < 0.1:
        return None
    measured = np.concatenate([sighting.measured for sighting in sightings])
    pose = _rigid_alignment(measured, positions)
    weight = np.linalg.inv(noise)
    for _ in range(10):
        rest = sighting_difference(measured, range_bearing(pose, positions))
        J = jacobian(pose, positions)
        information = J.T @ weight @ J
        step = np.linalg.lstsq(information, J.T @ weight @ rest, rcond=None)[0]
        pose = pose + step
        if float(np.abs(step).max()) < 1e-9:
            break

    def cost(pose: Float[np.ndarray, "3"]) -> float:
        rest = sighting_difference(measured, range_bearing(pose, positions))
        return float(rest @ weight @ rest)

    least = cost(pose)
    if not least <= chi_square_quantile(GATE_PROBABILITY, 2 * len(sightings) - 3):
        return None
    covariance = symmetric(np.linalg.inv(information))
    values, vectors = np.linalg.eigh(covariance)
    away = (2.0 * np.sqrt(values) * vectors).T
    if max(cost(pose + step) for step in (*away, *-away)) > least + 4.0 * STRAIGHT:
        return None
    pose[2:] = wrap_angles(pose[2:])
    return Gaussian(pose, covariance)


@dataclass(frozen=True)
class _Seen:
    """Sightings of one frame with the motion of the robot since.

    Args:
        measured: k times (range, bearing), m and rad.
        covariances: Of each.
        positions: Of their landmarks, world frame, m.
        motion: Of the robot since then, body frame of then.
        motion_covariance: Of (x, y, yaw) of that motion.
    """

    measured: Float[np.ndarray, "k 2"]
    covariances: Float[np.ndarray, "k 2 2"]
    positions: Float[np.ndarray, "k 2"]
    motion: Pose2
    motion_covariance: Float[np.ndarray, "3 3"]

    def moved(self, motion: Pose2, covariance: Float[np.ndarray, "3 3"]) -> _Seen:
        """The same after another motion, body frame, with its covariance."""
        after = self.motion @ motion
        F, G = np.eye(3), np.eye(3)
        F[:2, 2] = self.motion.y - after.y, after.x - self.motion.x
        G[:2, :2] = self.motion.rotation
        joined = F @ self.motion_covariance @ F.T + G @ covariance @ G.T
        return replace(self, motion=after, motion_covariance=joined)

    def explained(self, pose: Gaussian, gate: float) -> int:
        """Number of sightings inside the gate, if the robot has this pose now."""
        now = Pose2(*pose.mean.tolist())
        then = now @ self.motion.inverse()
        x, y = now.x - then.x, now.y - then.y
        by_now = np.array([[1.0, 0.0, y], [0.0, 1.0, -x], [0.0, 0.0, 1.0]])
        by_motion = np.zeros((3, 3))
        by_motion[:2, :2], by_motion[:, 2] = -then.rotation, (-y, x, -1.0)
        P = by_now @ pose.covariance @ by_now.T + by_motion @ self.motion_covariance @ by_motion.T
        J = jacobian(then.vector, self.positions).reshape(-1, 2, 3)
        expected = range_bearing(then.vector, self.positions)
        rest = sighting_difference(self.measured.ravel(), expected).reshape(-1, 2)
        S = J @ P @ J.transpose(0, 2, 1) + self.covariances
        nis = np.einsum("ki,ki->k", rest, np.linalg.solve(S, rest[..., None])[..., 0])
        return int(np.sum(nis <= gate))


class RecentSightings:
    """Sightings of the last frames, which a pose found anew should explain."""

    def __init__(self) -> None:
        self._seen: deque[_Seen] = deque(maxlen=REMEMBERED)

    def add(self, sightings: Sequence[Sighting], positions: Float[np.ndarray, "k 2"]) -> None:
        """Add those of a frame, with the positions of their landmarks, (k, 2), world frame, m."""
        if sightings:
            measured = np.array([one.measured for one in sightings])
            covariances = np.array([one.covariance for one in sightings])
            self._seen.append(_Seen(measured, covariances, positions, Pose2(), np.zeros((3, 3))))

    def move(self, motion: Pose2, covariance: Float[np.ndarray, "3 3"]) -> None:
        """Follow a motion of the robot, body frame; covariance of its (x, y, yaw), m and rad."""
        moved = [one.moved(motion, covariance) for one in self._seen]
        self._seen = deque(moved, maxlen=REMEMBERED)

    def clear(self) -> None:
        """Forget all."""
        self._seen.clear()

    def confirm(self, pose: Gaussian) -> bool:
        """Whether the robot's pose now, over (x, y, yaw), explains most of them; not without any."""
        gate = chi_square_quantile(GATE_PROBABILITY, 2)
        explained = sum(one.explained(pose, gate) for one in self._seen)
        return 2 * explained > sum(len(one.measured) for one in self._seen)


def jacobian(
    pose: Float[np.ndarray, "3"], positions: Float[np.ndarray, "k 2"]
) -> Float[np.ndarray, "2*k 3"]:
    """Derivative of (range, bearing, ...) of landmarks by (x, y, yaw)."""
    offset = positions - pose[:2]
    distance = np.hypot(offset[:, 0], offset[:, 1])
    J = np.empty((2 * len(positions), 3))
    J[0::2, 0], J[0::2, 1], J[0::2, 2] = -offset[:, 0] / distance, -offset[:, 1] / distance, 0.0
    J[1::2, 0] = offset[:, 1] / distance**2
    J[1::2, 1] = -offset[:, 0] / distance**2
    J[1::2, 2] = -1.0
    return J


def _rigid_alignment(measured: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """Pose (x, y, yaw) that aligns the measured with the known positions, with equal weights."""
    ranges, bearings = measured[0::2], measured[1::2]
    seen = np.stack([ranges * np.cos(bearings), ranges * np.sin(bearings)], axis=-1)
    a, b = seen - seen.mean(axis=0), positions - positions.mean(axis=0)
    yaw = math.atan2(float(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])), float(np.sum(a * b)))
    c, s = math.cos(yaw), math.sin(yaw)
    x, y = positions.mean(axis=0) - np.array([[c, -s], [s, c]]) @ seen.mean(axis=0)
    return np.array([x, y, yaw])
