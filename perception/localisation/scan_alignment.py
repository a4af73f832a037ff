"""Alignment of a scan with those of some keyframes, point to line: what their overlap says about the poses.

Correspondences and the current pose are found in turn, with fixed keyframes. The result is the measurement in the
overlap: the normal equations of the current pose and the keyframes together, without unobservable directions (along a
single wall, around a pillar).

Source: point to line, Censi 2008; robust weights, Cauchy. The rest is ours.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from ..primitives.pose import Pose2, wrap_angle
from . import _registration_kernels as kernels
from .keyframes import POSE_SIZE
from .scan import Scan, joined

CORRELATED = 1.5  # ours: number of neighbouring points with one common error
GATE_M = 0.08  # ours: largest distance of corresponding points once the pose is known
FACING_DEG = 35.0  # ours: largest angle between corresponding normals
OUTLIER_SIGMAS = 2.5  # ours: residual of half weight
ROUNDS = 8  # ours: iterations of association and pose


@dataclass(frozen=True)
class KeyframeScans:
    """The scans of some keyframes.

    Args:
        scan: All of them as one, world frame.
        first: Where each begins in it, and where the last one ends.
        poses: Sensor pose (x, y, yaw) of each, world frame, m and rad.
    """

    scan: Scan
    first: Int[np.ndarray, "k1"]
    poses: Float[np.ndarray, "k 3"]

    @classmethod
    def at(cls, poses: Float[np.ndarray, "k 3"], scans: Sequence[Scan]) -> KeyframeScans:
        """The scans, each in its sensor frame, at their poses."""
        placed = [one.at(Pose2(*pose.tolist())) for one, pose in zip(scans, poses, strict=True)]
        first = np.concatenate([[0], np.cumsum([len(one) for one in placed])]).astype(np.int64)
        return cls(joined(placed), first, poses)

    def correspondences(self, level: Scan, gate: float) -> Int[np.ndarray, "n k"]:
        """For each point of a scan, world frame, its partner in each keyframe; -1 if none is within the gate, m."""
        found = np.empty((len(level), len(self.poses)), np.int64)
        points, normals = self.scan.points, self.scan.normals
        cosine = math.cos(math.radians(FACING_DEG))
        kernels.correspondences(
            level.points, level.normals, points, normals, self.first, gate, cosine, found
        )
        return found


@dataclass(frozen=True)
class Alignment:
    """The result of an alignment.

    Args:
        correspondences: Number of points with one.
        roughness: Mean squared weighted residual, m^2.
        H: Derivative of the measurement, of unit noise, by the poses: the current one, then the keyframes.
        innovation: What it differs by from that at the expected poses.
    """

    correspondences: int
    roughness: float
    H: Float[np.ndarray, "z r"]
    innovation: Float[np.ndarray, "z"]


def align(
    scan: Scan,
    near: KeyframeScans,
    start: Pose2,
    gate: float,
    expected: Float[np.ndarray, "3"],
    trust: Float[np.ndarray, "3 3"],
) -> Alignment:
    """Correspondences and pose in turn with fixed keyframes; then the normal equations of all poses.

    Args:
        scan: Sensor frame.
        near: Keyframes that overlap with it.
        start: Sensor pose of the first round, world frame.
        gate: Largest distance of corresponding points in the first round, m; it narrows to `GATE_M`.
        expected: Sensor pose (x, y, yaw) that the state expects, m and rad.
        trust: Information on it if the keyframes were known exactly.
    """
    size = POSE_SIZE * (1 + len(near.poses))
    A, b = np.empty((size, size)), np.empty(size)
    now = start.vector
    used, roughness = 0, math.inf
    for turn in range(ROUNDS):
        level = scan.at(Pose2(*now.tolist()))
        reach = max(GATE_M, gate * 0.6**turn)
        found = near.correspondences(level, reach)
        cut = OUTLIER_SIGMAS if reach <= GATE_M else 3.0 * OUTLIER_SIGMAS
        used, roughness = kernels.accumulate(
            level.points, level.sigmas, now, near.scan.points, near.scan.normals,
            near.scan.sigmas, near.poses, found, cut, A, b,
        )  # fmt: skip
        A /= CORRELATED
        b /= CORRELATED
        back = _difference(expected, now)
        step = np.linalg.solve(A[:POSE_SIZE, :POSE_SIZE] + trust, b[:POSE_SIZE] + trust @ back)
        settled = reach <= GATE_M and float(np.max(np.abs(step))) < 2e-4
        if settled or turn == ROUNDS - 1:
            break
        now = now + step
    H, innovation = _observable(A, b + A[:, :POSE_SIZE] @ _difference(now, expected))
    return Alignment(used, roughness, H, innovation)


def _observable(
    A: Float[np.ndarray, "r r"], b: Float[np.ndarray, "r"]
) -> tuple[Float[np.ndarray, "z r"], Float[np.ndarray, "z"]]:
    """Normal equations A x = b as a measurement H x of unit noise, without the directions they say nothing about."""
    values, vectors = np.linalg.eigh(A)
    observable = values > 1e-6 * max(float(values[-1]), 1.0)
    root = np.sqrt(values[observable])
    H = root[:, None] * vectors[:, observable].T
    return H, (vectors[:, observable].T @ b) / root


def _difference(a: Float[np.ndarray, "3"], b: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    difference = a - b
    difference[2] = wrap_angle(float(difference[2]))
    return np.asarray(difference)
