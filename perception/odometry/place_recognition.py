"""Places known again: by features of their pictures, and whether the two lie over each other.

Each place keeps its strongest features with their points in space. Two places are compared by matching them;
three matches give a motion, and the motion most matches agree with is where the alignment starts. What is
not confirmed by the surfaces themselves is no recognition.

Source: seed 004 (MDGHM-SIFT); Fischler and Bolles 1981 (sampling); Horn 1987 (motion from points).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Float32

from ..features import pictures
from ..features.matching import MatchConfig, match
from ..features.mdghm_sift import SiftConfig, detect
from ..primitives.errors import ConfigError
from ..primitives.pose import Pose3
from .pyramid import Kept, Pyramid, keep


@dataclass(frozen=True)
class PlacesConfig:
    """How places are told apart."""

    sift: SiftConfig = field(default_factory=lambda: SiftConfig(upsample=False, most=250))
    match: MatchConfig = field(default_factory=MatchConfig)
    farthest_m: float = 5.0  # ours: points beyond are too unsure to tell a motion
    near_m: float = 0.03  # ours: matches agree with a motion if they come so close, at least
    near_share: float = 0.02  # ours: or so near, as a share of their distance
    samples: int = 300  # ours: triples; finds 15 % right ones with 63 %, 25 % with 99 %
    least_matches: int = 10  # ours: by chance, five or six agree

    def __post_init__(self) -> None:
        if self.samples < 1 or self.least_matches < 3:
            raise ConfigError(
                f"places: samples={self.samples} must be at least 1 and "
                f"least_matches={self.least_matches} at least 3"
            )
        for name in ("farthest_m", "near_m", "near_share"):
            if not getattr(self, name) > 0.0:
                raise ConfigError(f"places: {name}={getattr(self, name)} must be positive")


@dataclass(frozen=True, eq=False)
class Place:
    """What is kept of one reference image.

    Args:
        number: Of the image.
        image: Put away.
        descriptors: Of the strongest features that have depth, length 1.
        points: Where they are, camera frame, m.
    """

    number: int
    image: Kept
    descriptors: Float32[np.ndarray, "n 128"]
    points: Float[np.ndarray, "n 3"]


def remember(number: int, image: Pyramid, config: PlacesConfig | None = None) -> Place:
    """Make a place of an image; without a picture, its depth serves as one."""
    config = config or PlacesConfig()
    level = image.levels[0]
    valid = np.isfinite(level.z) & (level.z < config.farthest_m)
    if image.has_grey:
        picture = level.grey.astype(np.uint8)
    else:
        picture = pictures.range_picture(level.z, config.farthest_m)
    found = detect(picture, config.sift, valid)
    u, v = np.rint(found.pixels).astype(int).T
    points = level.camera.back_project(
        found.pixels.astype(np.float64), level.z[v, u].astype(np.float64)
    )
    return Place(number, keep(image), found.descriptors, points)


def likeness(place: Place, other: Place) -> float:
    """How alike two pictures are: mean of each feature's best product; 0 where there are none."""
    if len(place.descriptors) == 0 or len(other.descriptors) == 0:
        return 0.0
    best = (place.descriptors @ other.descriptors.T).max(axis=1)
    return float(np.mean(best > 0.85))


def motion_between(
    target: Place, source: Place, rng: np.random.Generator, config: PlacesConfig | None = None
) -> Pose3 | None:
    """T_target_source that most matches agree with.

    Returns:
        None where too few agree: another place, or too little to be seen.
    """
    config = config or PlacesConfig()
    pairs = match(target.descriptors, source.descriptors, config.match)
    if len(pairs) < config.least_matches:
        return None
    p, q = target.points[pairs[:, 0]], source.points[pairs[:, 1]]
    near = np.maximum(config.near_m, config.near_share * np.linalg.norm(p, axis=1))
    best = np.zeros(len(p), bool)
    for _ in range(config.samples):
        triple = rng.choice(len(p), 3, replace=False)
        R, t = _motion(p[triple], q[triple])
        agree = np.linalg.norm(q @ R.T + t - p, axis=1) < near
        if np.count_nonzero(agree) > np.count_nonzero(best):
            best = agree
    if np.count_nonzero(best) < config.least_matches:
        return None
    for _ in range(2):
        R, t = _motion(p[best], q[best])
        best = np.linalg.norm(q @ R.T + t - p, axis=1) < near
        if np.count_nonzero(best) < config.least_matches:
            return None
    return Pose3.from_rotation(R, t)


def _motion(
    p: Float[np.ndarray, "n 3"], q: Float[np.ndarray, "n 3"]
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]:
    """R, t with p = R q + t in least squares."""
    mean_p, mean_q = p.mean(axis=0), q.mean(axis=0)
    u, _, vt = np.linalg.svd((p - mean_p).T @ (q - mean_q))
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    R = (u * signs) @ vt
    return R, mean_p - R @ mean_q
