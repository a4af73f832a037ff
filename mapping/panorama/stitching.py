"""Stitching: features, pairs, pose graph of all views, and rendering on a sphere.

Each view reports its evidence: features, aligned surfaces, or the encoders alone. A view without enough
matches keeps its prior. Views without priors that features do not connect are aligned as whole images
(`dense_links`); one that cannot be aligned either is left out, with the reason.

Source: Kang 2013 (seed 004), Table 1 as reconstructed (Brown and Lowe 2007); surfaces and whole images are ours.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from perception.primitives.errors import ConfigError
from perception.primitives.pose import Pose3
from perception.primitives.settings import setting

from .adjustment import Placed, Prior, adjust
from .dense_links import ALIGNMENT, DenseViews, connect, stiffened
from .matches import Guide, ViewFeatures, extract_features, match_features
from .pairs import Link, PairConfig, motion_link, rotation_link
from .rendering import PX_PER_DEG, Drawing, render
from .surfaces import Alignment, Surface, align, surface
from .views import PriorConfig, View, prior_covariance

NECK_SIGMA_M = 0.002  # ours: play of the neck from one view to the next, while standing
PASSES = 2  # ours: searches for pairs, the second in narrower windows
START_RAD = math.radians(3.0)  # ours: standard deviation of a start from which depth is aligned
OVERLAP_RAD = math.radians(6.0)  # ours: views with a smaller overlap by their priors are no pair

Aligner = Callable[[Surface, Surface, Pose3, float], Alignment | None]
"""Target, source, start and the standard deviation of its position to the relative pose: see `surfaces.align`."""


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
    features: bool = True  # link pairs of views by features
    surfaces: bool = True  # align depth images where positions are estimated or known
    aligner: Aligner = align  # how they are aligned
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
    features = [extract_features(view, config.pairs.sift) for view in views]
    priors = [
        None
        if view.prior is None
        else Prior(view.prior, prior_covariance(view.prior, config.prior))
        for view in views
    ]
    links = _links(views, features, priors, rng, config) if config.features else []
    known_places = all(view.prior is not None for view in views)
    reasons: dict[int, str] = {}
    if config.surfaces and (config.moving or known_places):
        links = _with_surfaces(views, priors, links, config)
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
    priors: Sequence[Prior | None],
    rng: np.random.Generator,
    config: StitchConfig,
) -> list[Link]:
    """The best pairs of views accepted by their features. Each pass knows by the pairs of the last where to search."""
    links: list[Link] = []
    for _ in range(1 if config.moving else PASSES):
        placed = adjust(priors, links, rotations_only=True) if any(priors) else [None] * len(views)
        found = list(links)
        known = {(link.first, link.second) for link in links}
        for i, j in itertools.combinations(range(len(views)), 2):
            if (i, j) not in known and _may_overlap(views[i], views[j]):
                both = (features[i], features[j])
                if config.moving:
                    link = motion_link((i, j), both, match_features(*both), rng)
                else:
                    guide = _guide(placed, i, j, config.prior)
                    matches = match_features(*both, guide)
                    link = rotation_link((i, j), both, matches, guide, rng, config.pairs)
                if link is not None:
                    found.append(link)
        links = _best_links(found, len(views), config.partners)
    return links


def _guide(
    placed: Sequence[Placed | None], first: int, second: int, config: PriorConfig
) -> Guide | None:
    """What is known of two views; None if one of them is not placed."""
    one, other = placed[first], placed[second]
    if one is None or other is None or one.yaws is None or other.yaws is None:
        return None
    yaw = one.yaws[first] + other.yaws[second] - 2.0 * one.yaws[second]
    tilt = one.covariance[0, 0] + other.covariance[0, 0]
    between = other.T_base_camera.inverse() @ one.T_base_camera
    return Guide(between, math.sqrt(max(yaw, tilt)), math.sqrt(2.0) * config.position_m)


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


def _with_surfaces(
    views: Sequence[View], priors: Sequence[Prior | None], links: list[Link], config: StitchConfig
) -> list[Link]:
    """The links, and those of aligned depth.

    Between known positions both count: depth does not see a turn within a round wall, features do not see one about a
    line of them. The alignment starts where the features put the views. Of estimated positions depth refines the
    features, which are of the same pixels.
    """
    surfaces = [surface(view.depth) for view in views]
    if config.moving:
        return [_refined(link, surfaces, config.aligner) for link in links]
    placed = adjust(priors, links, rotations_only=True)
    aligned = list(links)
    for i, j in itertools.combinations(range(len(views)), 2):
        guide = _guide(placed, i, j, config.prior)
        if guide is None or guide.sigma_rad > START_RAD or not _may_overlap(views[i], views[j]):
            continue
        start = guide.T_second_first.inverse()
        found = config.aligner(surfaces[i], surfaces[j], start, NECK_SIGMA_M)
        if found is not None:
            aligned.append(Link(i, j, found.T_to_from, found.covariance, 0, 0, "surfaces"))
    return aligned


def _refined(link: Link, surfaces: Sequence[Surface], aligner: Aligner) -> Link:
    """A link of features, refined by aligning depth where that succeeds."""
    ends = surfaces[link.first], surfaces[link.second]
    found = aligner(*ends, link.T_first_second, math.inf)
    if found is None:
        return link
    return replace(link, T_first_second=found.T_to_from, covariance=found.covariance)
