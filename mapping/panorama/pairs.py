"""How one view lies to another, by features alone: robustly, with a covariance, or not at all.

Views of the same room share features. A pair is accepted if what agrees with one rotation (or one motion)
is more than chance would give: `n_inlier > 8.0 + 0.3 n_matches`. A rotation needs directions only; where
the camera's place is known too, what is near is first moved to where the other view would see it. A motion
needs depth at the features of both views.

Source: Brown and Lowe 2007 (acceptance), seed 004 section 4 as reconstructed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float, Float32, Int

from perception.features.matching import MatchConfig, match
from perception.features.mdghm_sift import SiftConfig, detect
from perception.primitives.errors import ConfigError
from perception.primitives.pose import CAMERA_IN_BODY_AXES, Pose3

from .sphere import direction, look_up, warp_picture, window_of_view
from .views import View


@dataclass(frozen=True)
class PairConfig:
    """What is a match, and how many make a pair."""

    sift: SiftConfig = field(default_factory=lambda: SiftConfig(most=1000))
    match: MatchConfig = field(default_factory=MatchConfig)
    accept_offset: float = 8.0  # Brown and Lowe 2007
    accept_share: float = 0.3  # Brown and Lowe 2007
    hypotheses: int = 300  # ours: three of four wrong still leaves 18 good pairs of features
    bearing_deg: float = 0.25  # ours: deviation of a feature's direction, without parallax
    travel_m: float = 0.02  # ours: unknown movement between views, seen as parallax of what is near
    range_share: float = 0.006  # ours: deviation of a feature's range, per range
    guided_deg: float = (
        2.5  # ours: encoders off by 0.5 deg each, three deviations, and a feature's own
    )
    gate_sigmas: float = 4.0  # ours: what is further off is no inlier

    def __post_init__(self) -> None:
        for name in (
            "accept_share",
            "bearing_deg",
            "travel_m",
            "range_share",
            "guided_deg",
            "gate_sigmas",
        ):
            if not getattr(self, name) > 0.0:
                raise ConfigError(f"pairs: {name}={getattr(self, name)} must be positive")
        if self.hypotheses < 1 or self.accept_offset < 3.0:
            raise ConfigError("pairs: hypotheses must be at least 1 and accept_offset at least 3")


@dataclass(frozen=True, eq=False)
class ViewFeatures:
    """Features of one view as directions with range.

    Args:
        bearings: Unit vectors, camera frame.
        range_m: Along them, NaN where there is none.
        descriptors: One each.
        picture: Which of the view's pictures each was found in; only like is matched with like.
    """

    bearings: Float[np.ndarray, "n 3"]
    range_m: Float[np.ndarray, "n"]
    descriptors: Float32[np.ndarray, "n 128"]
    picture: Int[np.ndarray, "n"]


@dataclass(frozen=True)
class Link:
    """How view `second` lies to view `first`.

    Args:
        T_first_second: Pose of the second camera in the first; a mere rotation has no translation.
        covariance: Rotation (rad^2), then translation (m^2), axes of the second camera.
        inliers, matches: n_i and n_f.
        by: "features" or "surfaces".
    """

    first: int
    second: int
    T_first_second: Pose3
    covariance: Float[np.ndarray, "6 6"]
    inliers: int
    matches: int
    by: str = "features"


def extract_features(view: View, config: PairConfig) -> ViewFeatures:
    """Features of a view's pictures, found on the sphere about its nominal direction."""
    camera = view.depth.camera
    nominal = nominal_rotation(view)
    sphere = window_of_view(camera, nominal, camera.fx)
    u, v = look_up(sphere, camera, nominal)
    bearings, descriptors, numbers = [], [], []
    for number, picture in enumerate(view.pictures):
        warped, shown = warp_picture(picture, u, v)
        found = detect(warped, config.sift, shown)
        x, y = found.pixels.astype(np.float64).T
        bearings.append(direction(*sphere.angles(x, y)) @ nominal)
        descriptors.append(found.descriptors)
        numbers.append(np.full(len(found), number))
    rays = np.concatenate(bearings) if bearings else np.zeros((0, 3))
    return ViewFeatures(
        rays,
        _ranges(view, rays),
        np.concatenate(descriptors) if descriptors else np.zeros((0, 128), np.float32),
        np.concatenate(numbers).astype(np.int64) if numbers else np.zeros(0, np.int64),
    )


def nominal_rotation(view: View) -> Float[np.ndarray, "3 3"]:
    """Camera axes in the base by the prior; looking straight ahead without one."""
    return CAMERA_IN_BODY_AXES if view.prior is None else view.prior.rotation


def _ranges(view: View, bearings: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
    """Range at directions: the nearest pixel's, or of its neighbours the nearest to the camera."""
    if len(bearings) == 0:
        return np.zeros(0)
    camera, z = view.depth.camera, view.depth.z
    pixels = np.nan_to_num(camera.project(bearings), nan=0.0)
    u = np.clip(np.rint(pixels[:, 0]).astype(int), 0, camera.width - 1)
    v = np.clip(np.rint(pixels[:, 1]).astype(int), 0, camera.height - 1)
    return z[v, u].astype(np.float64) / bearings[:, 2]


def match_features(
    first: ViewFeatures,
    second: ViewFeatures,
    config: PairConfig,
    T_second_first: Pose3 | None = None,
) -> Int[np.ndarray, "k 2"]:
    """Matches of two views, picture by picture.

    Args:
        first, second: Their features.
        config: What is a match.
        T_second_first: How the first view lies to the second by encoders; then only features that lie about
            where they must are in question, and far fewer go wrong. None: nobody knows.
    """
    near = None if T_second_first is None else _in_question(first, second, T_second_first, config)
    found = []
    for number in np.unique(first.picture):
        a, b = np.flatnonzero(first.picture == number), np.flatnonzero(second.picture == number)
        allowed = None if near is None else near[np.ix_(a, b)]
        pairs = match(first.descriptors[a], second.descriptors[b], config.match, allowed)
        found.append(np.column_stack([a[pairs[:, 0]], b[pairs[:, 1]]]))
    return np.concatenate(found) if found else np.zeros((0, 2), np.int64)


def _in_question(
    first: ViewFeatures, second: ViewFeatures, T_second_first: Pose3, config: PairConfig
) -> Bool[np.ndarray, "n m"]:
    """Which features of the second view lie about where the encoders say those of the first should."""
    usual = float(np.nanmedian(first.range_m)) if np.isfinite(first.range_m).any() else 2.0
    reach = np.where(np.isfinite(first.range_m), first.range_m, usual)
    there = T_second_first.apply(first.bearings * reach[:, None])
    there /= np.maximum(np.linalg.norm(there, axis=1, keepdims=True), 1e-9)
    return np.asarray(there @ second.bearings.T > math.cos(math.radians(config.guided_deg)))


def rotation_link(
    numbers: tuple[int, int],
    seen: tuple[ViewFeatures, ViewFeatures],
    pairs: Int[np.ndarray, "k 2"],
    offset: Float[np.ndarray, "3"] | None,
    rng: np.random.Generator,
    config: PairConfig,
) -> Link | None:
    """The rotation between two views, or None if too few matches agree on one.

    Args:
        numbers: Of the views.
        seen: Their features.
        pairs: Their matches.
        offset: Place of the first camera seen from the second, in the first's axes, m: what the second
            would see of a point p is p + offset. None: unknown; then what is near counts less.
        rng: Chance of the search.
        config: Gates.
    """
    first, second = seen[0].bearings[pairs[:, 0]], seen[1].bearings[pairs[:, 1]]
    range_m = seen[0].range_m[pairs[:, 0]]
    usual = float(np.nanmedian(range_m)) if np.isfinite(range_m).any() else 2.0
    near = np.where(np.isfinite(range_m), range_m, usual)
    if offset is not None:
        first = first * near[:, None] + offset
        first /= np.linalg.norm(first, axis=1, keepdims=True)
    sigma = np.hypot(math.radians(config.bearing_deg), config.travel_m / near)
    gate = np.full(len(pairs), config.gate_sigmas * math.radians(config.bearing_deg))
    inliers = _search(first, second, gate, None, rng, config)
    if inliers is None or not _accepted(inliers, pairs, config):
        return None
    rotation = np.eye(3)
    for _ in range(4):
        rotation = _turn(second[inliers], first[inliers], sigma[inliers] ** -2)
        off = np.linalg.norm(second @ rotation.T - first, axis=1)
        inliers = off < gate
        if not _accepted(inliers, pairs, config):
            return None
    kept, weight = second[inliers], sigma[inliers] ** -2
    hessian = np.einsum("n,nij->ij", weight, np.eye(3) - kept[:, :, None] * kept[:, None, :])
    square = max(1.0, float(np.mean((off[inliers] / sigma[inliers]) ** 2) / 2.0))
    covariance = np.zeros((6, 6))
    # the parallax of one movement is common to all features: it does not average out
    common = (config.travel_m if offset is None else 0.0) / float(np.median(near[inliers]))
    covariance[:3, :3] = square * np.linalg.inv(hessian) + common**2 * np.eye(3)
    pose = Pose3.from_rotation(rotation, np.zeros(3))
    return Link(*numbers, pose, covariance, int(inliers.sum()), len(pairs))


def motion_link(
    numbers: tuple[int, int],
    seen: tuple[ViewFeatures, ViewFeatures],
    pairs: Int[np.ndarray, "k 2"],
    rng: np.random.Generator,
    config: PairConfig,
) -> Link | None:
    """The motion between two views by features with depth, or None if too few agree on one."""
    range_a, range_b = seen[0].range_m[pairs[:, 0]], seen[1].range_m[pairs[:, 1]]
    known = np.isfinite(range_a) & np.isfinite(range_b)
    pairs, range_a, range_b = pairs[known], range_a[known], range_b[known]
    first = seen[0].bearings[pairs[:, 0]] * range_a[:, None]
    second = seen[1].bearings[pairs[:, 1]] * range_b[:, None]
    sigma = 0.005 + np.hypot(math.radians(config.bearing_deg), config.range_share) * range_b
    inliers = _search(first, second, config.gate_sigmas * sigma, 3, rng, config)
    if inliers is None or not _accepted(inliers, pairs, config):
        return None
    pose = Pose3()
    for _ in range(4):
        pose = _motion(second[inliers], first[inliers], sigma[inliers] ** -2)
        inliers = np.linalg.norm(pose.apply(second) - first, axis=1) < config.gate_sigmas * sigma
        if not _accepted(inliers, pairs, config):
            return None
    kept = second[inliers]
    jacobian = np.concatenate([-_cross_matrices(kept), np.tile(np.eye(3), (len(kept), 1, 1))], 2)
    hessian = np.einsum("n,nki,nkj->ij", sigma[inliers] ** -2, jacobian, jacobian)
    return Link(*numbers, pose, np.linalg.inv(hessian), int(inliers.sum()), len(pairs))


def _accepted(
    inliers: Bool[np.ndarray, "k"], pairs: Int[np.ndarray, "k 2"], config: PairConfig
) -> bool:
    return bool(inliers.sum() > config.accept_offset + config.accept_share * len(pairs))


def _search(
    first: Float[np.ndarray, "k 3"],
    second: Float[np.ndarray, "k 3"],
    gate: Float[np.ndarray, "k"],
    points: int | None,
    rng: np.random.Generator,
    config: PairConfig,
) -> Bool[np.ndarray, "k"] | None:
    """The largest set that agrees with a rotation from two directions, or a motion from three points."""
    if len(first) <= config.accept_offset:
        return None
    count = points or 2
    draws = np.argsort(rng.random((config.hypotheses, len(first))), axis=1)[:, :count]
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


def _turn(
    source: Float[np.ndarray, "n 3"],
    target: Float[np.ndarray, "n 3"],
    weight: Float[np.ndarray, "n"],
) -> Float[np.ndarray, "3 3"]:
    """Rotation with least weighted squares from source to target (Kabsch 1976)."""
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
    rotation = _turn(source - middle_s, target - middle_t, weight)
    return Pose3.from_rotation(rotation, middle_t - rotation @ middle_s)


def _cross_matrices(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3 3"]:
    out = np.zeros((len(points), 3, 3))
    x, y, z = points.T
    out[:, 0, 1], out[:, 0, 2], out[:, 1, 2] = -z, y, -x
    return np.asarray(out - out.transpose(0, 2, 1))
