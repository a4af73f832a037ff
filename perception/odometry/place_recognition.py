"""Place recognition: features propose a relative pose, which the alignment then verifies.

Each place keeps its strongest features with their points in space. Two places are compared by matching them;
three matches determine a motion, and the motion with the most inliers is the initial pose of the alignment.
Without an alignment that fits, the place is not recognised.

Source: seed 004 (MDGHM-SIFT); Fischler and Bolles 1981 (RANSAC); Horn 1987 (motion from points).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float, Float32

from ..features import pictures
from ..features.matching import MatchConfig, match
from ..features.mdghm_sift import SiftConfig, detect
from ..primitives.pose import Pose3
from .pyramid import CompressedImage, Pyramid, compress

FARTHEST_M = 5.0  # ours: farther points are too uncertain
NEAR_M = 0.03  # ours: distance of an inlier, at least
NEAR_SHARE = 0.02  # ours: or as a share of its depth
SAMPLES = 300  # ours: triples; finds 15 % inliers with 63 %, 25 % with 99 %
LEAST_MATCHES = 10  # ours: five or six agree by chance
SIMILAR = 0.85  # ours: least product of two descriptors of one feature
COARSE_PX = 200.0  # ours: a shorter focal length shows a third of the features of a usual one


@dataclass(frozen=True)
class PlacesConfig:
    """Features of places and their matching."""

    sift: SiftConfig = field(default_factory=lambda: SiftConfig(upsample=False, most=250))
    match: MatchConfig = field(default_factory=MatchConfig)


@dataclass(frozen=True, eq=False)
class Place:
    """Features of one reference image.

    Args:
        number: Of the image.
        image: Compressed.
        descriptors: Of the strongest features with depth, unit length.
        points: Their positions, camera frame, m.
    """

    number: int
    image: CompressedImage
    descriptors: Float32[np.ndarray, "n 128"]
    points: Float[np.ndarray, "n 3"]


def for_any_camera(config: PlacesConfig, image: Pyramid) -> PlacesConfig:
    """The features that match those of other cameras: a coarse image is upsampled, to show as fine ones as another."""
    coarse = image.levels[0].camera.fx < COARSE_PX
    return replace(config, sift=replace(config.sift, upsample=config.sift.upsample or coarse))


def describe(
    number: int, image: Pyramid, config: PlacesConfig | None = None, by_depth: bool = False
) -> Place:
    """Extract the place of an image; without a colour image, or if asked, its depth serves as one."""
    config = config or PlacesConfig()
    level = image.levels[0]
    valid = np.isfinite(level.z) & (level.z < FARTHEST_M)
    if image.has_grey and not by_depth:
        picture = level.grey.astype(np.uint8)
    else:
        picture = pictures.range_picture(level.z, FARTHEST_M)
    found = detect(picture, config.sift, valid)
    u, v = np.rint(found.pixels).astype(int).T
    points = level.camera.back_project(
        found.pixels.astype(np.float64), level.z[v, u].astype(np.float64)
    )
    return Place(number, compress(image), found.descriptors, points)


def similarity(place: Place, other: Place) -> float:
    """Share of features with a close match in the other place; 0 without features."""
    if len(place.descriptors) == 0 or len(other.descriptors) == 0:
        return 0.0
    best = (place.descriptors @ other.descriptors.T).max(axis=1)
    return float(np.mean(best > SIMILAR))


def motion_between(
    target: Place, source: Place, rng: np.random.Generator, config: PlacesConfig | None = None
) -> Pose3 | None:
    """T_target_source with the most inliers among the matches.

    Returns:
        None if inliers are too few: another place, or too little texture.
    """
    config = config or PlacesConfig()
    pairs = match(target.descriptors, source.descriptors, config.match)
    if len(pairs) < LEAST_MATCHES:
        return None
    p, q = target.points[pairs[:, 0]], source.points[pairs[:, 1]]
    near = np.maximum(NEAR_M, NEAR_SHARE * np.linalg.norm(p, axis=1))
    best = np.zeros(len(p), bool)
    for _ in range(SAMPLES):
        triple = rng.choice(len(p), 3, replace=False)
        R, t = _rigid_motion(p[triple], q[triple])
        inliers = np.linalg.norm(q @ R.T + t - p, axis=1) < near
        if np.count_nonzero(inliers) > np.count_nonzero(best):
            best = inliers
    if np.count_nonzero(best) < LEAST_MATCHES:
        return None
    for _ in range(2):
        R, t = _rigid_motion(p[best], q[best])
        best = np.linalg.norm(q @ R.T + t - p, axis=1) < near
        if np.count_nonzero(best) < LEAST_MATCHES:
            return None
    return Pose3.from_rotation(R, t)


def _rigid_motion(
    p: Float[np.ndarray, "n 3"], q: Float[np.ndarray, "n 3"]
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]:
    """R, t with p = R q + t in least squares."""
    mean_p, mean_q = p.mean(axis=0), q.mean(axis=0)
    u, _, vt = np.linalg.svd((p - mean_p).T @ (q - mean_q))
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    R = (u * signs) @ vt
    return R, mean_p - R @ mean_q
