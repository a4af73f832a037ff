"""Relative pose of two views by features: robust, with a covariance, or none.

A pair is accepted if more matches agree with one rotation (or one motion) than by chance. Without encoders that is
`n_inlier > 8.0 + 0.3 n_matches`. Encoders restrict the candidates of a feature to a window; a wrong match lies anywhere
in it, so how many agree by chance is a binomial number, and a pair of five matches can be sure. A rotation needs
directions only; if the position of the camera is known too, the features are first moved to where the other view sees
them, which corrects the parallax of near ones. A motion needs depth at the features of both views.

Source: Brown and Lowe 2007 (acceptance without encoders); Moisan and Stival 2004 (number of false alarms); Kang 2013
(seed 004), section 4 as reconstructed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.stats import binom

from perception.features.mdghm_sift import SiftConfig
from perception.primitives.errors import ConfigError
from perception.primitives.pose import Pose3

from .matches import BEARING_RAD, GATE_SIGMAS, Guide, ViewFeatures, range_or_usual

ACCEPT_OFFSET = 8.0  # Brown and Lowe 2007
ACCEPT_SHARE = 0.3  # Brown and Lowe 2007
HYPOTHESES = 300  # ours: with three of four matches wrong, 18 samples are still free of outliers
RANGE_SHARE = 0.006  # ours: relative standard deviation of a feature's range
FALSE_ALARMS = 0.01  # ours: expected number of rotations with as many inliers by chance


@dataclass(frozen=True)
class PairConfig:
    """Features, and the motion between views."""

    sift: SiftConfig = field(default_factory=lambda: SiftConfig(most=1000))
    travel_m: float = 0.02  # ours: unknown translation between views (parallax of near points)

    def __post_init__(self) -> None:
        if not self.travel_m > 0.0:
            raise ConfigError(f"pairs: travel_m={self.travel_m} must be positive")


@dataclass(frozen=True)
class Link:
    """Relative pose of two views: an edge of the pose graph.

    Args:
        first, second: Indices of the views.
        T_first_second: Pose of the second camera in the first; a rotation has zero translation.
        covariance: Rotation (rad^2), then translation (m^2), axes of the second camera.
        inliers, matches: n_i and n_f.
        by: "features", "surfaces", or "alignment" of whole images.
    """

    first: int
    second: int
    T_first_second: Pose3
    covariance: Float[np.ndarray, "6 6"]
    inliers: int
    matches: int
    by: str = "features"


def rotation_link(
    numbers: tuple[int, int],
    features: tuple[ViewFeatures, ViewFeatures],
    pairs: Int[np.ndarray, "k 2"],
    guide: Guide | None,
    rng: np.random.Generator,
    config: PairConfig,
) -> Link | None:
    """The rotation between two views, or None if too few matches agree on one, or on one that the guide excludes.

    Args:
        numbers: Indices of the views.
        features: Their features.
        pairs: Their matches.
        guide: None: unknown; then near features get less weight, and the link has no translation. Otherwise the
            translation is the guide's, with a standard deviation of `config.travel_m`.
        rng: Random numbers of the search.
        config: Unknown translation.
    """
    first, second = features[0].bearings[pairs[:, 0]], features[1].bearings[pairs[:, 1]]
    near = range_or_usual(features[0].range_m[pairs[:, 0]])
    gate = np.full(len(pairs), GATE_SIGMAS * BEARING_RAD)
    sigma, chance, shift_m = np.hypot(BEARING_RAD, config.travel_m / near), None, config.travel_m
    if guide is not None:
        first = first * near[:, None] + guide.offset
        first /= np.linalg.norm(first, axis=1, keepdims=True)
        chance = (GATE_SIGMAS * BEARING_RAD / guide.window_rad) ** 2
        sigma, shift_m = np.full(len(pairs), BEARING_RAD), guide.sigma_m
    inliers = _search(first, second, gate, None, rng)
    if inliers is None or not _accepted(inliers, chance):
        return None
    rotation = np.eye(3)
    for _ in range(4):
        rotation = _rotation(second[inliers], first[inliers], sigma[inliers] ** -2)
        off = np.linalg.norm(second @ rotation.T - first, axis=1)
        inliers = off < gate
        if not _accepted(inliers, chance):
            return None
    kept, weight = second[inliers], sigma[inliers] ** -2
    hessian = np.einsum("n,nij->ij", weight, np.eye(3) - kept[:, :, None] * kept[:, None, :])
    square = max(1.0, float(np.mean((off[inliers] / sigma[inliers]) ** 2) / 2.0))
    covariance = config.travel_m**2 * np.eye(6)
    # the parallax of one translation is common to all features: it does not average out
    common = shift_m / float(np.median(near[inliers]))
    covariance[:3, :3] = square * np.linalg.inv(hessian) + common**2 * np.eye(3)
    position = np.zeros(3) if guide is None else guide.T_second_first.inverse().position
    pose = Pose3.from_rotation(rotation, position)
    if guide is not None and _turned(guide.T_second_first @ pose) > guide.window_rad:
        return None  # as of few features, all on a line
    return Link(*numbers, pose, covariance, int(inliers.sum()), len(pairs))


def _turned(pose: Pose3) -> float:
    """Angle of its rotation, rad."""
    cosine = (float(np.trace(pose.rotation)) - 1.0) / 2.0
    return math.acos(min(max(cosine, -1.0), 1.0))


def motion_link(
    numbers: tuple[int, int],
    features: tuple[ViewFeatures, ViewFeatures],
    pairs: Int[np.ndarray, "k 2"],
    rng: np.random.Generator,
) -> Link | None:
    """The motion between two views by features with depth, or None if too few agree on one."""
    range_a, range_b = features[0].range_m[pairs[:, 0]], features[1].range_m[pairs[:, 1]]
    known = np.isfinite(range_a) & np.isfinite(range_b)
    pairs, range_a, range_b = pairs[known], range_a[known], range_b[known]
    first = features[0].bearings[pairs[:, 0]] * range_a[:, None]
    second = features[1].bearings[pairs[:, 1]] * range_b[:, None]
    sigma = 0.005 + np.hypot(BEARING_RAD, RANGE_SHARE) * range_b
    inliers = _search(first, second, GATE_SIGMAS * sigma, 3, rng)
    if inliers is None or not _accepted(inliers, None):
        return None
    pose = Pose3()
    for _ in range(4):
        pose = _motion(second[inliers], first[inliers], sigma[inliers] ** -2)
        inliers = np.linalg.norm(pose.apply(second) - first, axis=1) < GATE_SIGMAS * sigma
        if not _accepted(inliers, None):
            return None
    kept = second[inliers]
    jacobian = np.concatenate([-_cross_matrices(kept), np.tile(np.eye(3), (len(kept), 1, 1))], 2)
    hessian = np.einsum("n,nki,nkj->ij", sigma[inliers] ** -2, jacobian, jacobian)
    return Link(*numbers, pose, np.linalg.inv(hessian), int(inliers.sum()), len(pairs))


def _accepted(inliers: Bool[np.ndarray, "k"], chance: float | None) -> bool:
    """Whether more matches agree than by chance.

    Args:
        inliers: Of the matches.
        chance: Probability that a wrong match agrees with a given rotation; None: unknown.
    """
    matches, agree = len(inliers), int(inliers.sum())
    if chance is None:
        return agree > ACCEPT_OFFSET + ACCEPT_SHARE * matches
    if agree <= 2:  # two define the rotation
        return False
    tried = min(HYPOTHESES, math.comb(matches, 2))
    return bool(tried * binom.sf(agree - 3, matches - 2, chance) < FALSE_ALARMS)


def _search(
    first: Float[np.ndarray, "k 3"],
    second: Float[np.ndarray, "k 3"],
    gate: Float[np.ndarray, "k"],
    points: int | None,
    rng: np.random.Generator,
) -> Bool[np.ndarray, "k"] | None:
    """Largest set of inliers of a rotation from two directions, or of a motion from three points."""
    count = points or 2
    if len(first) <= count:
        return None
    draws = np.argsort(rng.random((HYPOTHESES, len(first))), axis=1)[:, :count]
    a, b = first[draws], second[draws]
    if points:
        frames_a, frames_b = (_frames(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]) for p in (a, b))
    else:
        frames_a, frames_b = (_frames(p[:, 0] + p[:, 1], p[:, 0] - p[:, 1]) for p in (a, b))
    rotations = frames_a @ frames_b.transpose(0, 2, 1)
    moved = np.einsum("hij,kj->hki", rotations, second)
    if points:
        moved += (a.mean(axis=1) - np.einsum("hij,hj->hi", rotations, b.mean(axis=1)))[:, None]
    off = np.linalg.norm(moved - first, axis=2)
    agree = off < gate
    return np.asarray(agree[int(np.argmax(agree.sum(axis=1)))])


def _frames(x: Float[np.ndarray, "h 3"], other: Float[np.ndarray, "h 3"]) -> np.ndarray:
    """Orthonormal axes from two vectors, as columns."""
    x = x / np.maximum(np.linalg.norm(x, axis=1, keepdims=True), 1e-12)
    z = np.cross(x, other)
    z /= np.maximum(np.linalg.norm(z, axis=1, keepdims=True), 1e-12)
    return np.stack([x, np.cross(z, x), z], axis=2)


def _rotation(
    source: Float[np.ndarray, "n 3"],
    target: Float[np.ndarray, "n 3"],
    weight: Float[np.ndarray, "n"],
) -> Float[np.ndarray, "3 3"]:
    """Rotation by weighted least squares from source to target (Kabsch 1976)."""
    u, _, vt = np.linalg.svd((source * weight[:, None]).T @ target)
    flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(vt.T @ u.T))])
    return np.asarray(vt.T @ flip @ u.T)


def _motion(
    source: Float[np.ndarray, "n 3"],
    target: Float[np.ndarray, "n 3"],
    weight: Float[np.ndarray, "n"],
) -> Pose3:
    share = weight / weight.sum()
    middle_s, middle_t = share @ source, share @ target
    rotation = _rotation(source - middle_s, target - middle_t, weight)
    return Pose3.from_rotation(rotation, middle_t - rotation @ middle_s)


def _cross_matrices(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3 3"]:
    out = np.zeros((len(points), 3, 3))
    x, y, z = points.T
    out[:, 0, 1], out[:, 0, 2], out[:, 1, 2] = -z, y, -x
    return np.asarray(out - out.transpose(0, 2, 1))
