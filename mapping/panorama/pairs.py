"""Relative pose of two views by features: robust, with a covariance, or none.

A pair is accepted if more matches agree with one rotation (or one motion) than by chance: `n_inlier > 8.0 +
0.3 n_matches`. A rotation needs directions only; if the position of the camera is known too, the features are
first moved to where the other view sees them, which corrects the parallax of near ones. A motion needs depth
at the features of both views.

Source: Brown and Lowe 2007 (acceptance); Kang 2013 (seed 004), section 4 as reconstructed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float, Float32, Int

from perception.features.matching import match
from perception.features.mdghm_sift import SiftConfig, detect
from perception.primitives.errors import ConfigError
from perception.primitives.pose import CAMERA_IN_BODY_AXES, Pose3

from .sphere import direction, look_up, warp_picture, window_of_view
from .views import View

ACCEPT_OFFSET = 8.0  # Brown and Lowe 2007
ACCEPT_SHARE = 0.3  # Brown and Lowe 2007
HYPOTHESES = 300  # ours: with three of four matches wrong, 18 samples are still free of outliers
BEARING_RAD = math.radians(0.25)  # ours: sigma of a feature's direction without parallax
RANGE_SHARE = 0.006  # ours: relative standard deviation of a feature's range
GUIDED_RAD = math.radians(2.5)  # ours: encoders 0.5 deg each, three sigmas, plus the feature's own
GATE_SIGMAS = 4.0  # ours: matches further off are outliers
USUAL_RANGE_M = 2.0  # ours: assumed range if no feature has one


@dataclass(frozen=True)
class PairConfig:
    """Features, and the motion between views."""

    sift: SiftConfig = field(default_factory=lambda: SiftConfig(most=1000))
    travel_m: float = 0.02  # ours: unknown translation between views (parallax of near points)

    def __post_init__(self) -> None:
        if not self.travel_m > 0.0:
            raise ConfigError(f"pairs: travel_m={self.travel_m} must be positive")


@dataclass(frozen=True, eq=False)
class ViewFeatures:
    """Features of one view as directions with range.

    Args:
        bearings: Unit vectors, camera frame.
        range_m: Range along them, NaN where unknown.
        descriptors: Descriptor of each feature.
        picture: Index of the view's image that shows the feature; features match within one image kind.
    """

    bearings: Float[np.ndarray, "n 3"]
    range_m: Float[np.ndarray, "n"]
    descriptors: Float32[np.ndarray, "n 128"]
    picture: Int[np.ndarray, "n"]


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


def extract_features(view: View, config: PairConfig) -> ViewFeatures:
    """Features of a view's images, detected on the sphere about its nominal direction."""
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
    """Camera axes in the base by the prior; straight ahead without one."""
    return CAMERA_IN_BODY_AXES if view.prior is None else view.prior.rotation


def _ranges(view: View, bearings: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
    """Range at directions, from the nearest pixel."""
    if len(bearings) == 0:
        return np.zeros(0)
    camera, z = view.depth.camera, view.depth.z
    pixels = np.nan_to_num(camera.project(bearings), nan=0.0)
    u = np.clip(np.rint(pixels[:, 0]).astype(int), 0, camera.width - 1)
    v = np.clip(np.rint(pixels[:, 1]).astype(int), 0, camera.height - 1)
    return z[v, u].astype(np.float64) / bearings[:, 2]


def match_features(
    first: ViewFeatures, second: ViewFeatures, T_second_first: Pose3 | None = None
) -> Int[np.ndarray, "k 2"]:
    """Match the features of two views, image by image.

    Args:
        first, second: Their features.
        T_second_first: Relative pose by encoders. It restricts the candidates to features near their
            predicted direction, with far fewer outliers. None: unknown.
    """
    near = None if T_second_first is None else _candidates(first, second, T_second_first)
    found = []
    for number in np.unique(first.picture):
        a, b = np.flatnonzero(first.picture == number), np.flatnonzero(second.picture == number)
        allowed = None if near is None else near[np.ix_(a, b)]
        pairs = match(first.descriptors[a], second.descriptors[b], None, allowed)
        found.append(np.column_stack([a[pairs[:, 0]], b[pairs[:, 1]]]))
    return np.concatenate(found) if found else np.zeros((0, 2), np.int64)


def _range_or_usual(range_m: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
    """Ranges with the median in place of unknown ones."""
    usual = float(np.nanmedian(range_m)) if np.isfinite(range_m).any() else USUAL_RANGE_M
    return np.where(np.isfinite(range_m), range_m, usual)


def _candidates(
    first: ViewFeatures, second: ViewFeatures, T_second_first: Pose3
) -> Bool[np.ndarray, "n m"]:
    """Whether each feature of the second view is close to the predicted direction of each of the first."""
    reach = _range_or_usual(first.range_m)
    there = T_second_first.apply(first.bearings * reach[:, None])
    there /= np.maximum(np.linalg.norm(there, axis=1, keepdims=True), 1e-9)
    return np.asarray(there @ second.bearings.T > math.cos(GUIDED_RAD))


def rotation_link(
    numbers: tuple[int, int],
    features: tuple[ViewFeatures, ViewFeatures],
    pairs: Int[np.ndarray, "k 2"],
    offset: Float[np.ndarray, "3"] | None,
    rng: np.random.Generator,
    config: PairConfig,
) -> Link | None:
    """The rotation between two views, or None if too few matches agree on one.

    Args:
        numbers: Indices of the views.
        features: Their features.
        pairs: Their matches.
        offset: Position of the first camera relative to the second, in the first's axes, m: the second
            camera sees a point p at p + offset. None: unknown; then near features get less weight.
        rng: Random numbers of the search.
        config: Unknown translation.
    """
    first, second = features[0].bearings[pairs[:, 0]], features[1].bearings[pairs[:, 1]]
    near = _range_or_usual(features[0].range_m[pairs[:, 0]])
    if offset is not None:
        first = first * near[:, None] + offset
        first /= np.linalg.norm(first, axis=1, keepdims=True)
    sigma = np.hypot(BEARING_RAD, config.travel_m / near)
    gate = np.full(len(pairs), GATE_SIGMAS * BEARING_RAD)
    inliers = _search(first, second, gate, None, rng)
    if inliers is None or not _accepted(inliers, pairs):
        return None
    rotation = np.eye(3)
    for _ in range(4):
        rotation = _rotation(second[inliers], first[inliers], sigma[inliers] ** -2)
        off = np.linalg.norm(second @ rotation.T - first, axis=1)
        inliers = off < gate
        if not _accepted(inliers, pairs):
            return None
    kept, weight = second[inliers], sigma[inliers] ** -2
    hessian = np.einsum("n,nij->ij", weight, np.eye(3) - kept[:, :, None] * kept[:, None, :])
    square = max(1.0, float(np.mean((off[inliers] / sigma[inliers]) ** 2) / 2.0))
    covariance = np.zeros((6, 6))
    # the parallax of one translation is common to all features: it does not average out
    common = (config.travel_m if offset is None else 0.0) / float(np.median(near[inliers]))
    covariance[:3, :3] = square * np.linalg.inv(hessian) + common**2 * np.eye(3)
    pose = Pose3.from_rotation(rotation, np.zeros(3))
    return Link(*numbers, pose, covariance, int(inliers.sum()), len(pairs))


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
    if inliers is None or not _accepted(inliers, pairs):
        return None
    pose = Pose3()
    for _ in range(4):
        pose = _motion(second[inliers], first[inliers], sigma[inliers] ** -2)
        inliers = np.linalg.norm(pose.apply(second) - first, axis=1) < GATE_SIGMAS * sigma
        if not _accepted(inliers, pairs):
            return None
    kept = second[inliers]
    jacobian = np.concatenate([-_cross_matrices(kept), np.tile(np.eye(3), (len(kept), 1, 1))], 2)
    hessian = np.einsum("n,nki,nkj->ij", sigma[inliers] ** -2, jacobian, jacobian)
    return Link(*numbers, pose, np.linalg.inv(hessian), int(inliers.sum()), len(pairs))


def _accepted(inliers: Bool[np.ndarray, "k"], pairs: Int[np.ndarray, "k 2"]) -> bool:
    return bool(inliers.sum() > ACCEPT_OFFSET + ACCEPT_SHARE * len(pairs))


def _search(
    first: Float[np.ndarray, "k 3"],
    second: Float[np.ndarray, "k 3"],
    gate: Float[np.ndarray, "k"],
    points: int | None,
    rng: np.random.Generator,
) -> Bool[np.ndarray, "k"] | None:
    """Largest set of inliers of a rotation from two directions, or of a motion from three points."""
    if len(first) <= ACCEPT_OFFSET:
        return None
    count = points or 2
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
