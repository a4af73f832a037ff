"""Links between two sessions of one place: pairs of images that show the same surfaces, and whether there are any.

Place recognition proposes motions between images of the two sessions, dense alignment verifies each of them both
ways, and the largest set of proposals that agree on one motion of the whole session is kept. It predicts which other
images overlap, and these are aligned too: those that fit become links, and those that do not speak against the place.
Two rooms may share a corner, so what the images show of each other's free space decides. Compact volumes that only one
session saw filled are furniture that was moved, if that explains the images better (`moved_volumes`).

Source: seed 004 (features); Fischler and Bolles 1981 (consensus); Newcombe et al. 2011 (alignment); the check by
free space and the probability are ours.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from ..primitives.pose import Pose3
from .alignment import AlignConfig, Alignment, align, evaluate
from .moved_volumes import ComparedImages, MovedVolume, compared_images, moved_volumes
from .place_recognition import (
    LEAST_MATCHES,
    SIMILAR,
    Place,
    PlacesConfig,
    describe,
    for_any_camera,
    motion_between,
)
from .pyramid import Pyramid

# Ours, as all thresholds below: chosen on homes of seeds 100 to 104 and a synthetic room.
LEAST_ALIKE = 0.12  # share of features with a close match, of a proposal
ALIKE = 2  # proposals of each image
MOST_PROPOSALS = 60  # of two sessions, the most similar ones
LEAST_FITTING = 0.75
"""Least share of inliers of a link; smaller than for a loop closure, as furniture may have moved."""
MOST_CONTRADICTING = 0.15  # likewise; a moved chair near the camera fills that much
LEAST_VISIBLE = 0.35  # a smaller overlap may be a single edge
BACK_M, BACK_RAD = 0.03, math.radians(1.5)  # there and back again, at most
AGREE_M, AGREE_RAD = 0.25, math.radians(8.0)
"""Largest difference between two links that agree; includes the drift within the sessions."""
NEAR_M, NEAR_RAD = 1.0, math.radians(40.0)  # images this close share most of their view
NEIGHBOURS = 3  # images of the first session that each image of the second is aligned with
CACHED = 48  # decompressed images of a session
PRIOR = 0.01  # probability that two sessions show one place
PER_VIEW = 1.6  # log odds by each image of the smaller side that is linked
MOST_VIEWS = 6  # images that count: more of them are not independent
FITS, PER_FITTING = 0.80, 25.0
"""Evidence by the inliers of all overlapping images: share that is neutral, and log odds per share."""
FREE, PER_FREE = 0.06, 60.0  # the same for points in the other session's free space
PER_MOVED = 2.0  # log odds against one place by each volume that something left or filled
LEAST_LEFT = 0.5  # share of the points that such volumes leave, at least
ONLY_CHANCE = 1e-6  # no probability is closer to 0 or 1


@dataclass(frozen=True, eq=False)
class View:
    """An image of a session.

    Args:
        place: Its features and its compressed image.
        T_session_camera: Its pose in the axes of the session.
    """

    place: Place
    T_session_camera: Pose3


class Session:
    """The images of one session, in order of time; recently used ones are kept decompressed.

    Args:
        views: The images.
        of_depth: Whether their features are of depth images though there is colour.
    """

    def __init__(self, views: Sequence[View], of_depth: bool = False) -> None:
        self.views, self._of_depth = tuple(views), of_depth
        self._pyramids: dict[int, Pyramid] = {}
        counts = [len(view.place.descriptors) for view in self.views]
        self._begins = np.concatenate([[0], np.cumsum(counts)])
        parts = [view.place.descriptors for view in self.views if len(view.place.descriptors)]
        self._descriptors = np.concatenate(parts) if parts else np.zeros((0, 128), np.float32)

    def __len__(self) -> int:
        return len(self.views)

    def pose(self, index: int) -> Pose3:
        """T_session_camera of an image."""
        return self.views[index].T_session_camera

    def pyramid(self, index: int) -> Pyramid:
        """An image, ready for alignment."""
        if index not in self._pyramids:
            if len(self._pyramids) >= CACHED:
                del self._pyramids[next(iter(self._pyramids))]
            self._pyramids[index] = self.views[index].place.image.pyramid()
        return self._pyramids[index]

    @cached_property
    def has_colour(self) -> bool:
        """Whether the features of most of its images are of pictures, not of depth."""
        images = [view.place.image for view in self.views]
        count = sum(image.grey.shape == image.z.shape for image in images)
        return not self._of_depth and 2 * count > len(images)

    @cached_property
    def by_depth(self) -> Session:
        """The same with the features of its depth images, as those of a camera without colour."""
        views = []
        for view in self.views:
            image = view.place.image.pyramid()
            place = describe(
                view.place.number, image, for_any_camera(PlacesConfig(), image), by_depth=True
            )
            views.append(View(place, view.T_session_camera))
        return Session(views, of_depth=True)

    def similarities(self, place: Place) -> Float[np.ndarray, "n"]:
        """Of every image: the share of a place's features with a close match in it."""
        found = np.zeros(len(self))
        if not len(place.descriptors) or not len(self._descriptors):
            return found
        products = place.descriptors @ self._descriptors.T
        for index in range(len(self)):
            block = products[:, self._begins[index] : self._begins[index + 1]]
            if block.shape[1]:
                found[index] = float(np.mean(block.max(axis=1) > SIMILAR))
        return found


@dataclass(frozen=True)
class Link:
    """Relative pose of an image of the first session and one of the second.

    Args:
        before, after: Indices of the images in their sessions.
        motion: T_before_after.
        covariance: (6, 6) of (x, y, z, rotation vector), axes of the first image, m and rad.
    """

    before: int
    after: int
    motion: Pose3
    covariance: Float[np.ndarray, "6 6"]


@dataclass(frozen=True)
class PairLinks:
    """What links two sessions.

    Args:
        links: Agreeing ones.
        probability: That both show one place, at the motion of the links; NaN if the two were not compared.
        views: Linked images of the session that has fewer of them.
        compared: Pairs of images that overlap if it is one place.
        fitting: Share of inliers over all of these, without what was moved; NaN without any.
        contradicting: Share of points where the other session saw free space; likewise.
        moved: Volumes that something moved has left or filled.
        reason: Why the two were not compared; empty if they were.
    """

    links: tuple[Link, ...] = ()
    probability: float = ONLY_CHANCE
    views: int = 0
    compared: int = 0
    fitting: float = math.nan
    contradicting: float = math.nan
    moved: int = 0
    reason: str = ""


def link_sessions(
    first: Session,
    second: Session,
    rng: np.random.Generator,
    places: PlacesConfig | None = None,
    config: AlignConfig | None = None,
) -> PairLinks:
    """Find the links between two sessions.

    Args:
        first, second: The sessions.
        rng: Samples matches of features.
        places: Features and their matching; the defaults if None.
        config: Alignment; the default if None.

    Returns:
        No links and a small probability where nothing is recognised; an unknown one if it could not be, since a
        session shows too few features, or has no colour. Without colour in one session, both are recognised by depth.
    """
    places, config = places or PlacesConfig(), config or AlignConfig()
    if first.has_colour != second.has_colour:
        first, second = first.by_depth, second.by_depth
    proposed = list(_proposals(first, second, rng, places, config))
    agreed = _consensus(first, second, proposed)
    if not agreed:
        return _not_recognised(first, second)
    links, compared = _overlapping(first, second, agreed, config)
    links = _consensus(first, second, links)
    views = min(len({one.before for one in links}), len({one.after for one in links}))
    visible = sum(one.visible for one, _ in compared)
    if not links or not visible > 0.0:
        return PairLinks()
    fitting = sum(one.fitting * one.visible for one, _ in compared) / visible
    against = sum(one.contradicting * one.visible for one, _ in compared) / visible
    volumes = moved_volumes([images for _, images in compared])
    fitting, against, moved = _without_moved(fitting, against, volumes)
    probability = place_probability(views, fitting, against, moved)
    return PairLinks(tuple(links), probability, views, len(compared), fitting, against, moved)


def _not_recognised(first: Session, second: Session) -> PairLinks:
    """No links; whether that speaks against one place."""
    both = (first, second)
    most = min(max((len(v.place.descriptors) for v in one.views), default=0) for one in both)
    if most < LEAST_MATCHES:
        return PairLinks(
            probability=math.nan, reason="too few features in every image of a session"
        )
    if not first.has_colour or not second.has_colour:
        return PairLinks(probability=math.nan, reason="nothing recognised by depth alone")
    return PairLinks()


def place_probability(views: int, fitting: float, contradicting: float, moved: int = 0) -> float:
    """Probability that two sessions show one place.

    Args:
        views: Linked images of the session that has fewer of them.
        fitting: Share of inliers over all overlapping images.
        contradicting: Share of points in free space of the other session.
        moved: Volumes left out of both shares, as something moved has left or filled them.

    Source: ours: log odds of the four, as if they were independent.
    """
    odds = math.log(PRIOR / (1.0 - PRIOR)) + PER_VIEW * min(views, MOST_VIEWS)
    odds += _fit_odds(fitting, contradicting) - PER_MOVED * moved
    chance = 1.0 / (1.0 + math.exp(-float(np.clip(odds, -30.0, 30.0))))
    return min(max(chance, ONLY_CHANCE), 1.0 - ONLY_CHANCE)


def _fit_odds(fitting: float, contradicting: float) -> float:
    """Log odds by how the overlapping images fit."""
    return PER_FITTING * (fitting - FITS) - PER_FREE * (contradicting - FREE)


def _without_moved(
    fitting: float, contradicting: float, volumes: Sequence[MovedVolume]
) -> tuple[float, float, int]:
    """Both shares without the volumes that explain more than they cost, and the number of these."""
    left, moved = 1.0, 0
    for volume in volumes:
        rest = left - volume.contradicting - volume.hidden
        if rest < LEAST_LEFT:
            continue
        fits = min(fitting * left / rest, 1.0)
        against = max(contradicting * left - volume.contradicting, 0.0) / rest
        if _fit_odds(fits, against) - _fit_odds(fitting, contradicting) > PER_MOVED:
            fitting, contradicting, left, moved = fits, against, rest, moved + 1
    return fitting, contradicting, moved


def _proposals(
    first: Session,
    second: Session,
    rng: np.random.Generator,
    places: PlacesConfig,
    config: AlignConfig,
) -> Iterator[Link]:
    """Links of images that look alike."""
    candidates = []
    for after, view in enumerate(second.views):
        alike = first.similarities(view.place)
        for before in np.argsort(-alike, kind="stable")[:ALIKE].tolist():
            if alike[before] >= LEAST_ALIKE:
                candidates.append((-float(alike[before]), before, after))
    for _, before, after in sorted(candidates)[:MOST_PROPOSALS]:
        start = motion_between(first.views[before].place, second.views[after].place, rng, places)
        if start is not None:
            link = _verified(first, second, before, after, start, config)[0]
            if link is not None:
                yield link


def _verified(
    first: Session, second: Session, before: int, after: int, start: Pose3, config: AlignConfig
) -> tuple[Link | None, Alignment | None]:
    """A link by alignment from a start, None unless it fits both ways; and the alignment itself."""
    target, source = first.pyramid(before), second.pyramid(after)
    aligned = align(target, source, [start], config)
    if aligned is None or not _acceptable(aligned):
        return None, aligned
    back = align(source, target, [aligned.motion.inverse()], config)
    if back is None or not _acceptable(back):
        return None, aligned
    if not _close(aligned.motion @ back.motion, Pose3(), BACK_M, BACK_RAD):
        return None, aligned
    return Link(before, after, aligned.motion, aligned.covariance), aligned


def _acceptable(aligned: Alignment) -> bool:
    return (
        aligned.fitting >= LEAST_FITTING
        and aligned.contradicting <= MOST_CONTRADICTING
        and aligned.visible >= LEAST_VISIBLE
    )


def _close(one: Pose3, other: Pose3, most_m: float, most_rad: float) -> bool:
    apart = float(np.linalg.norm(one.position - other.position))
    return apart <= most_m and _angle(one.rotation, other.rotation) <= most_rad


def _angle(one: Float[np.ndarray, "3 3"], other: Float[np.ndarray, "3 3"]) -> float:
    """Angle between two rotations, rad."""
    cosine = (float(np.sum(one * other)) - 1.0) / 2.0
    return math.acos(min(1.0, max(-1.0, cosine)))


def between(first: Session, second: Session, link: Link) -> Pose3:
    """T_first_second, the motion of the whole session that a link means."""
    there = second.pose(link.after).inverse()
    return first.pose(link.before) @ link.motion @ there


def _consensus(first: Session, second: Session, links: Sequence[Link]) -> list[Link]:
    """The largest set of links that agree with one of them where their images are."""
    motions = [between(first, second, link) for link in links]
    best: list[Link] = []
    for motion in motions:
        agreeing = [
            link
            for link, own in zip(links, motions, strict=True)
            if _close(
                motion @ second.pose(link.after), own @ second.pose(link.after), AGREE_M, AGREE_RAD
            )
        ]
        if len(agreeing) > len(best):
            best = agreeing
    return best


def _overlapping(
    first: Session, second: Session, agreed: Sequence[Link], config: AlignConfig
) -> tuple[list[Link], list[tuple[Alignment, ComparedImages]]]:
    """Links of all images that should overlap, and how well each of these pairs fits.

    The motion of the session is that of the link nearest in time, so drift within the sessions does no harm.
    """
    links = {(one.before, one.after): one for one in agreed}
    compared: list[tuple[Alignment, ComparedImages]] = []
    known = {one.after: between(first, second, one) for one in agreed}
    order = sorted(range(len(second)), key=lambda n: (min(abs(n - k) for k in known), n))
    for after in order:
        nearest = min(known, key=lambda k: (abs(k - after), k))
        expected = known[nearest] @ second.pose(after)
        for before in _neighbours(first, expected):
            start = first.pose(before).inverse() @ expected
            link, aligned = _verified(first, second, before, after, start, config)
            pair = first.pyramid(before), second.pyramid(after)
            if aligned is not None and not _close(start, aligned.motion, AGREE_M, AGREE_RAD):
                link, aligned = None, evaluate(*pair, start.matrix)
            if aligned is not None and aligned.visible >= LEAST_VISIBLE:
                images = compared_images(*pair, first.pose(before), aligned.motion, aligned.visible)
                compared.append((aligned, images))
            if link is not None:
                links[before, after] = link
                known[after] = between(first, second, link)
    return [links[key] for key in sorted(links)], compared


def _neighbours(session: Session, expected: Pose3) -> list[int]:
    """Images of a session whose view is most like an expected one, nearest first."""
    found = []
    for index in range(len(session)):
        pose = session.pose(index)
        away = float(np.linalg.norm(pose.position - expected.position)) / NEAR_M
        turned = math.acos(float(np.clip(pose.rotation[:, 2] @ expected.rotation[:, 2], -1.0, 1.0)))
        if away < 1.0 and turned < NEAR_RAD:
            found.append((away + turned / NEAR_RAD, index))
    return [index for _, index in sorted(found)[:NEIGHBOURS]]
