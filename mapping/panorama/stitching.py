"""From views to a panorama: features, pairs, all poses at once, then range on a sphere.

What a view rests upon is told for each: features, surfaces laid upon each other, or the encoders alone.
Nothing is guessed: a view without enough matches keeps its prior, a view without a prior and without
matches is left out.

Source: seed 004, Table 1 as reconstructed (Brown and Lowe 2007); surfaces are ours.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from perception.primitives.errors import ConfigError
from perception.primitives.pose import Pose3

from .adjustment import Placed, Prior, adjust
from .pairs import (
    Link,
    PairConfig,
    ViewFeatures,
    extract_features,
    match_features,
    motion_link,
    rotation_link,
)
from .rendering import Drawing, RenderConfig, render
from .surfaces import Surface, SurfaceConfig, align, surface
from .views import PriorConfig, View, prior_covariance


@dataclass(frozen=True)
class StitchConfig:
    """The steps of a panorama."""

    moving: bool = False  # adjust places too; else the camera turns about a known (or no) place
    surfaces: bool = True  # where places are adjusted or known: lay depth images upon each other
    partners: int = 6  # Brown and Lowe 2007: partners of each view; 0 takes all
    neck_m: float = 0.002  # ours: play of the neck from one view to the next, while standing
    overlap_deg: float = 6.0  # ours: views whose priors say they share less are not compared
    pairs: PairConfig = field(default_factory=PairConfig)
    surface: SurfaceConfig = field(default_factory=SurfaceConfig)
    prior: PriorConfig = field(default_factory=PriorConfig)
    render: RenderConfig = field(default_factory=RenderConfig)

    def __post_init__(self) -> None:
        if self.partners < 0:
            raise ConfigError(f"stitch: partners={self.partners} must not be negative")
        if not self.neck_m > 0.0:
            raise ConfigError(f"stitch: neck_m={self.neck_m} must be positive")


@dataclass(frozen=True, eq=False)
class Panorama:
    """The panoramic environment map.

    Args:
        placed: One a view: pose, covariance and what carries it; None for a view left out.
        links: The pairs that were used.
        drawing: Range, sigma and age on the sphere; None if no view is placed.
    """

    placed: list[Placed | None]
    links: list[Link]
    drawing: Drawing | None


def stitch(
    views: Sequence[View], rng: np.random.Generator, config: StitchConfig | None = None
) -> Panorama:
    """Place the views and draw them.

    Args:
        views: In any order.
        rng: Chance of the searches.
        config: Which steps.
    """
    config = config or StitchConfig()
    placed, links = place(views, rng, config)
    return Panorama(placed, links, render(views, placed, config.render))


def place(
    views: Sequence[View], rng: np.random.Generator, config: StitchConfig
) -> tuple[list[Placed | None], list[Link]]:
    """Only the poses, and the pairs they rest upon."""
    seen = [extract_features(view, config.pairs) for view in views]
    priors = [
        None
        if view.prior is None
        else Prior(view.prior, prior_covariance(view.prior, config.prior))
        for view in views
    ]
    links = _links(views, seen, rng, config)
    links = _chosen(links, len(views), config.partners)
    known_places = all(view.prior is not None for view in views)
    if config.surfaces and (config.moving or known_places):
        links = _laid(views, links, config)
        return adjust(priors, links, rotations_only=False), links
    return adjust(priors, links, rotations_only=not config.moving), links


def _links(
    views: Sequence[View],
    seen: Sequence[ViewFeatures],
    rng: np.random.Generator,
    config: StitchConfig,
) -> list[Link]:
    """All pairs of views that features accept."""
    links = []
    for i, j in itertools.combinations(range(len(views)), 2):
        if not _may_overlap(views[i], views[j], config.overlap_deg):
            continue
        both = (seen[i], seen[j])
        if config.moving:
            matches = match_features(*both, config.pairs)
            link = motion_link((i, j), both, matches, rng, config.pairs)
        else:
            told = _between(views[i].prior, views[j].prior)
            matches = match_features(*both, config.pairs, told)
            offset = _offset(views[i].prior, views[j].prior)
            link = rotation_link((i, j), both, matches, offset, rng, config.pairs)
            if link is not None and told is not None and _contradicts(link, told, config.pairs):
                link = None
        if link is not None:
            links.append(link)
    return links


def _between(first: Pose3 | None, second: Pose3 | None) -> Pose3 | None:
    """T_second_first by the priors; None without them."""
    return None if first is None or second is None else second.inverse() @ first


def _contradicts(link: Link, T_second_first: Pose3, config: PairConfig) -> bool:
    """Whether a pair turns further from the encoders than these can be off: few features, all in a line."""
    turn = T_second_first.rotation @ link.T_first_second.rotation
    cosine = (float(np.trace(turn)) - 1.0) / 2.0
    return cosine < math.cos(math.radians(config.guided_deg))


def _offset(first: Pose3 | None, second: Pose3 | None) -> np.ndarray | None:
    """The first camera seen from the second, first's axes; None without priors."""
    if first is None or second is None:
        return None
    return np.asarray(first.rotation.T @ (first.position - second.position))


def _may_overlap(first: View, second: View, overlap_deg: float) -> bool:
    """Whether two views share some of their width by their priors; yes where one has none."""
    if first.prior is None or second.prior is None:
        return True
    reach = 0.0
    for view in (first, second):
        camera = view.depth.camera
        reach += math.atan(math.hypot(camera.width / camera.fx, camera.height / camera.fy) / 2.0)
    between = float(first.prior.rotation[:, 2] @ second.prior.rotation[:, 2])
    aside = math.acos(min(max(between, -1.0), 1.0))
    return aside < reach - math.radians(overlap_deg)


def _chosen(links: list[Link], count: int, partners: int) -> list[Link]:
    """Of each view's pairs the best, and then ranks that double: what is far apart stiffens the chain."""
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


def _laid(views: Sequence[View], links: list[Link], config: StitchConfig) -> list[Link]:
    """The pairs again by their depth, from where features or priors put them."""
    thin: list[Surface] = [surface(view.depth, config.surface) for view in views]
    by_pair = {(link.first, link.second): link for link in links}
    if not config.moving:  # priors are good enough to begin from
        for i, j in itertools.combinations(range(len(views)), 2):
            if (i, j) not in by_pair and _may_overlap(views[i], views[j], config.overlap_deg):
                by_pair[i, j] = Link(i, j, Pose3(), np.eye(6), 0, 0, "surfaces")
    laid = []
    for (i, j), link in sorted(by_pair.items()):
        start = link.T_first_second
        one, other = views[i].prior, views[j].prior
        if not config.moving and one is not None and other is not None:
            by_prior = one.inverse() @ other
            rotation = start.rotation if link.by == "features" else by_prior.rotation
            start = Pose3.from_rotation(rotation, by_prior.position)
        still = math.inf if config.moving else config.neck_m
        found = align(thin[i], thin[j], start, config.surface, still)
        if found is not None:
            laid.append(replace(link, T_first_second=found.T_to_from, covariance=found.covariance))
        elif link.by == "features":
            laid.append(link)
    return laid
