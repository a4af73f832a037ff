"""Stitching: features, pairs, pose graph of all views, and rendering on a sphere.

Each view reports its evidence: features, aligned surfaces, or the encoders alone. A view without enough
matches keeps its prior. Views without priors that features do not connect are aligned as whole images
(`dense_links`); one that cannot be aligned either is left out, with the reason.

Source: Kang 2013 (seed 004), Table 1 as reconstructed (Brown and Lowe 2007); surfaces and whole images are ours.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from perception.primitives.errors import ConfigError
from perception.primitives.pose import Pose3
from perception.primitives.settings import setting

from .adjustment import Placed, Prior, adjust
from .dense_links import ALIGNMENT, DenseViews, connect, stiffened
from .pairs import (
    GUIDED_RAD,
    Link,
    PairConfig,
    ViewFeatures,
    extract_features,
    match_features,
    motion_link,
    rotation_link,
)
from .rendering import PX_PER_DEG, Drawing, render
from .surfaces import align, surface
from .views import PriorConfig, View, prior_covariance

NECK_SIGMA_M = 0.002  # ours: play of the neck from one view to the next, while standing
OVERLAP_RAD = math.radians(6.0)  # ours: views with a smaller overlap by their priors are no pair


@dataclass(frozen=True)
class StitchConfig:
    """The steps of a panorama."""

    partners: int = setting(
        6, "", "pairs used for each view, the best first; 0 uses all", "Brown and Lowe 2007"
    )
    px_per_deg: float = setting(
        PX_PER_DEG, "px/deg", "resolution of the panorama", "seed 004: 176 px over 44 deg"
    )
    moving: bool = False  # estimate positions too; else the camera rotates about known positions
    surfaces: bool = True  # align depth images where positions are estimated or known
    pairs: PairConfig = field(default_factory=PairConfig)
    prior: PriorConfig = field(default_factory=PriorConfig)

    def __post_init__(self) -> None:
        if self.partners < 0:
            raise ConfigError(f"stitch: partners={self.partners} must not be negative")
        if not self.px_per_deg > 0.0:
            raise ConfigError(f"stitch: px_per_deg={self.px_per_deg} must be positive")


@dataclass(frozen=True, eq=False)
class Panorama:
    """The panoramic environment map.

    Args:
        placed: Pose, covariance and evidence of each view; None for a view left out.
        links: The pairs in use.
        drawing: Range, sigma and age on the sphere; None if no view is placed.
    """

    placed: list[Placed | None]
    links: list[Link]
    drawing: Drawing | None


class Placement(NamedTuple):
    """Where the views are.

    Args:
        placed: Pose, covariance and evidence of each view; None for a view left out.
        links: The pairs in use.
        reasons: Of each view left out, by its number.
    """

    placed: list[Placed | None]
    links: list[Link]
    reasons: dict[int, str]


def stitch(
    views: Sequence[View], rng: np.random.Generator, config: StitchConfig | None = None
) -> Panorama:
    """Estimate the poses of the views and draw them.

    Args:
        views: In any order.
        rng: Random numbers of the searches.
        config: The steps.
    """
    config = config or StitchConfig()
    placed, links, _ = place(views, rng, config)
    return Panorama(placed, links, render(views, placed, config.px_per_deg))


def place(views: Sequence[View], rng: np.random.Generator, config: StitchConfig) -> Placement:
    """Estimate the poses of the views.

    Args:
        views: In any order; if their positions are estimated, those without priors in order of time.
        rng: Random numbers of the searches.
        config: The steps.
    """
    features = [extract_features(view, config.pairs) for view in views]
    priors = [
        None
        if view.prior is None
        else Prior(view.prior, prior_covariance(view.prior, config.prior))
        for view in views
    ]
    links = _links(views, features, rng, config)
    links = _best_links(links, len(views), config.partners)
    known_places = all(view.prior is not None for view in views)
    reasons: dict[int, str] = {}
    if config.surfaces and (config.moving or known_places):
        links = _align_surfaces(views, links, config)
        if config.moving and not any(priors):
            links, reasons = _by_whole_images(views, features, links, priors, rng)
        placed = adjust(priors, links, rotations_only=False)
    else:
        placed = adjust(priors, links, rotations_only=not config.moving)
    left_out = [number for number, one in enumerate(placed) if one is None]
    return Placement(
        placed, links, {n: reasons.get(n, "no pair with a placed view") for n in left_out}
    )


def _by_whole_images(
    views: Sequence[View],
    features: Sequence[ViewFeatures],
    links: list[Link],
    priors: Sequence[Prior | None],
    rng: np.random.Generator,
) -> tuple[list[Link], dict[int, str]]:
    """The links that depth does not contradict, those of whole images where features fail, and what is left out."""
    images = DenseViews(views, rng)
    links = [link for link in links if not images.contradicts(link)]
    links, failed = connect(images, links, len(views))
    if any(link.by == ALIGNMENT for link in links):
        placed = adjust(priors, links, rotations_only=False)
        poses = [None if one is None else one.T_base_camera for one in placed]
        links = stiffened(images, links, poses)
    return links, {
        number: f"{len(features[number].bearings)} features, too few agree with another view; {why}"
        for number, why in failed.items()
    }


def _links(
    views: Sequence[View],
    features: Sequence[ViewFeatures],
    rng: np.random.Generator,
    config: StitchConfig,
) -> list[Link]:
    """All pairs of views accepted by their features."""
    links = []
    for i, j in itertools.combinations(range(len(views)), 2):
        if not _may_overlap(views[i], views[j]):
            continue
        both = (features[i], features[j])
        if config.moving:
            link = motion_link((i, j), both, match_features(*both), rng)
        else:
            expected = _between(views[i].prior, views[j].prior)
            matches = match_features(*both, expected)
            offset = _offset(views[i].prior, views[j].prior)
            link = rotation_link((i, j), both, matches, offset, rng, config.pairs)
            if link is not None and expected is not None and _contradicts(link, expected):
                link = None
        if link is not None:
            links.append(link)
    return links


def _between(first: Pose3 | None, second: Pose3 | None) -> Pose3 | None:
    """T_second_first by the priors; None without them."""
    return None if first is None or second is None else second.inverse() @ first


def _contradicts(link: Link, T_second_first: Pose3) -> bool:
    """Whether a link is outside the encoders' error, as for few features, all on a line."""
    turn = T_second_first.rotation @ link.T_first_second.rotation
    cosine = (float(np.trace(turn)) - 1.0) / 2.0
    return cosine < math.cos(GUIDED_RAD)


def _offset(first: Pose3 | None, second: Pose3 | None) -> np.ndarray | None:
    """Position of the first camera relative to the second, first's axes, m; None without priors."""
    if first is None or second is None:
        return None
    return np.asarray(first.rotation.T @ (first.position - second.position))


def _may_overlap(first: View, second: View) -> bool:
    """Whether two views overlap by their priors; true without priors."""
    if first.prior is None or second.prior is None:
        return True
    reach = 0.0
    for view in (first, second):
        camera = view.depth.camera
        reach += math.atan(math.hypot(camera.width / camera.fx, camera.height / camera.fy) / 2.0)
    between = float(first.prior.rotation[:, 2] @ second.prior.rotation[:, 2])
    angle = math.acos(min(max(between, -1.0), 1.0))
    return angle < reach - OVERLAP_RAD


def _best_links(links: list[Link], count: int, partners: int) -> list[Link]:
    """The best links of each view, at ranks that double: links of distant views stiffen the chain."""
    if partners == 0:
        return links
    kept: set[tuple[int, int]] = set()
    for number in range(count):
        mine = [link for link in links if number in (link.first, link.second)]
        mine.sort(key=lambda link: (-link.inliers, link.first, link.second))
        ranks = [2**k - 1 for k in range(partners) if 2**k - 1 < len(mine)]
        ranks += [rank for rank in range(len(mine)) if rank not in ranks]
        kept |= {(mine[rank].first, mine[rank].second) for rank in ranks[:partners]}
    return [link for link in links if (link.first, link.second) in kept]


def _align_surfaces(views: Sequence[View], links: list[Link], config: StitchConfig) -> list[Link]:
    """The links refined by aligning depth, starting from features or priors."""
    surfaces = [surface(view.depth) for view in views]
    by_pair = {(link.first, link.second): link for link in links}
    if not config.moving:  # the priors are good enough as a start
        for i, j in itertools.combinations(range(len(views)), 2):
            if (i, j) not in by_pair and _may_overlap(views[i], views[j]):
                by_pair[i, j] = Link(i, j, Pose3(), np.eye(6), 0, 0, "surfaces")
    refined = []
    for (i, j), link in sorted(by_pair.items()):
        start = link.T_first_second
        one, other = views[i].prior, views[j].prior
        if not config.moving and one is not None and other is not None:
            by_prior = one.inverse() @ other
            rotation = start.rotation if link.by == "features" else by_prior.rotation
            start = Pose3.from_rotation(rotation, by_prior.position)
        position_sigma = math.inf if config.moving else NECK_SIGMA_M
        found = align(surfaces[i], surfaces[j], start, position_sigma)
        if found is not None:
            refined.append(
                replace(link, T_first_second=found.T_to_from, covariance=found.covariance)
            )
        elif link.by == "features":
            refined.append(link)
    return refined
