"""Relative poses by whole images, for views that features do not connect: blurred, bare, full of holes, or far apart.

Views follow each other in time, so a view is aligned with its neighbours in time, from several turns about the
vertical. The floor, if both show it, gives tilt and height of each start. A pair is accepted as odometry accepts a
step, but in both directions, and only if both directions agree; so a view is rather left out than placed wrongly.

Source: Kerl et al. 2013 (dense alignment, see `perception.odometry`); the test in both directions is ours.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from perception.depth import points
from perception.floor import choose
from perception.floor.levelling import camera_above_floor
from perception.floor.prior import handheld_prior
from perception.odometry import alignment
from perception.odometry.alignment import Alignment
from perception.odometry.back_end import LEAST_VISIBLE
from perception.odometry.hypotheses import rotation_starts
from perception.odometry.odometry import LEAST_FITTING, MOST_CONTRADICTING, MOST_SIGMA_M
from perception.odometry.pyramid import Pyramid, build
from perception.odometry.rgbd_odometry import FLOOR_REACH_M, FLOOR_STRIDE
from perception.odometry.view_errors import ViewErrorSize
from perception.primitives.pose import Pose3

from .adjustment import largest_set, linked_sets
from .pairs import Link
from .views import View

# Ours: a view is aligned with the next and the next but one, so that one bad view is no gap. Farther in time, a view
# fits a place that only looks the same, as the other side of a box.
SKIPPED = 2
NEIGHBOURS = 4  # ours: views before and after in time that stiffen a chain, from known poses
BOTH_WAYS = float(chi2.ppf(0.999, 6))  # ours: the two directions agree within this
NEAR_RAD = math.radians(5.0)  # ours: the alignment converges from within 5 deg
NEAR_M = 0.15  # ours: and from half its first gate
ALIGNMENT = "alignment"  # how these links are called


class Attempt(NamedTuple):
    """The result of aligning two views: the link, or why there is none."""

    link: Link | None
    reason: str = ""


class DenseViews:
    """The views as image pyramids, each built when it is first needed."""

    def __init__(self, views: Sequence[View], rng: np.random.Generator) -> None:
        self._views = views
        self._rng = rng
        self._built: dict[int, Pyramid] = {}

    def image(self, number: int) -> Pyramid:
        """The pyramid of a view, with its floor if it shows one."""
        if number not in self._built:
            view = self._views[number]
            seen = points.from_depth(view.depth, *FLOOR_REACH_M, FLOOR_STRIDE)
            floor = choose.find(seen, handheld_prior(None), self._rng)
            grey = None if view.grey is None else np.repeat(view.grey[..., None], 3, axis=2)
            self._built[number] = build(view.depth, grey, None if floor is None else floor.plane)
        return self._built[number]

    def align(self, first: int, second: int, start: Pose3 | None = None) -> Attempt:
        """Align two views.

        Args:
            first, second: Their numbers.
            start: T_first_second if it is roughly known; None tries turns of both sides.
        """
        target, source = self.image(first), self.image(second)
        there = alignment.align(
            target, source, _starts(target, source) if start is None else [start]
        )
        fault = _fault(there, target)
        if there is None or fault:
            return Attempt(None, fault)
        back = alignment.align(source, target, [there.motion.inverse()])
        fault = _fault(back, source)
        if back is None or fault:
            return Attempt(None, fault)
        bend = _view_error(target, source)
        if not _agree(there, back, bend):
            return Attempt(None, "its alignment differs from that in the other direction")
        link = Link(first, second, there.motion, _in_link_order(there, bend), 0, 0, ALIGNMENT)
        return Attempt(link)

    def contradicts(self, link: Link) -> bool:
        """Whether one view has many points where the other saw free space, or hardly any on its surfaces."""
        first, second, pose = self.image(link.first), self.image(link.second), link.T_first_second
        for target, source, motion in ((first, second, pose), (second, first, pose.inverse())):
            found = alignment.evaluate(target, source, motion.matrix)
            if found is None or found.contradicting > MOST_CONTRADICTING:
                return True
        return False


def connect(images: DenseViews, links: list[Link], count: int) -> tuple[list[Link], dict[int, str]]:
    """Connect the sets of views that have no chain of links to each other, by aligning neighbours in time.

    Args:
        images: The views, in order of time.
        links: By features.
        count: Number of views.

    Returns:
        All links, and the reason for each view that has no chain to the largest set.
    """
    found, failed = list(links), dict[int, str]()
    for apart in range(1, SKIPPED + 1):
        for first in range(count - apart):
            second = first + apart
            group = linked_sets(found, count)
            if group[first] == group[second]:
                continue
            attempt = images.align(first, second)
            if attempt.link is not None:
                found.append(attempt.link)
                continue
            failed.setdefault(first, f"view {second}: {attempt.reason}")
            failed.setdefault(second, f"view {first}: {attempt.reason}")
    group = linked_sets(found, count)
    largest = largest_set(group)
    reasons = {}
    for number in set(range(count)) - largest:
        own = [n for n in range(count) if group[n] == group[number]]
        gaps = [failed[n] for n in sorted(own, key=lambda n: abs(n - number)) if n in failed]
        alone = "" if len(own) == 1 else f"placed with {len(own) - 1} others only; "
        reasons[number] = f"{alone}nearest in time is {gaps[0]}" if gaps else "the only view"
    return found, reasons


def stiffened(images: DenseViews, links: list[Link], poses: Sequence[Pose3 | None]) -> list[Link]:
    """The links, and those of neighbours in time of each aligned view, which stiffen the chain."""
    found, known = list(links), {(link.first, link.second) for link in links}
    chained = {n for link in links if link.by == ALIGNMENT for n in (link.first, link.second)}
    for number in sorted(chained):
        for other in range(max(number - NEIGHBOURS, 0), min(number + NEIGHBOURS + 1, len(poses))):
            pair = (min(number, other), max(number, other))
            one, two = poses[pair[0]], poses[pair[1]]
            if number == other or pair in known or one is None or two is None:
                continue
            known.add(pair)
            expected = one.inverse() @ two
            link = images.align(*pair, expected).link
            if link is not None and _is_near(link.T_first_second, expected):
                found.append(link)
    return found


def _is_near(motion: Pose3, expected: Pose3) -> bool:
    """Whether an alignment has stayed in the neighbourhood from which it converges."""
    off = expected.inverse() @ motion
    turned = float(Rotation.from_matrix(off.rotation).magnitude())
    return turned < NEAR_RAD and float(np.linalg.norm(off.position)) < NEAR_M


def _starts(target: Pyramid, source: Pyramid) -> list[Pose3]:
    """Initial motions: none, and turns to both sides; level and at equal height if both show the floor."""
    level = Pose3()
    if target.floor is not None and source.floor is not None:
        level = camera_above_floor(target.floor).inverse() @ camera_above_floor(source.floor)
    return [Pose3(), level, *rotation_starts(target, level)]


def _measured(image: Pyramid) -> float:
    """Share of the pixels of an image that have depth."""
    return float(np.isfinite(image.levels[0].z).mean())


def _fault(found: Alignment | None, target: Pyramid) -> str:
    """Why an alignment is not accepted; empty if it is."""
    if found is None:
        return "the images do not determine a motion"
    visible = found.visible / max(
        _measured(target), 1e-6
    )  # holes there hide no more than their share
    if visible < LEAST_VISIBLE:
        return f"{visible:.0%} of it is in view there, {LEAST_VISIBLE:.0%} is needed"
    if found.contradicting > MOST_CONTRADICTING:
        return f"{found.contradicting:.0%} of its points lie where that view saw free space"
    if found.fitting < LEAST_FITTING:
        return f"{found.fitting:.0%} of its points fit, {LEAST_FITTING:.0%} are needed"
    sigma_m = float(np.sqrt(np.diag(found.covariance)[:3].max()))
    if sigma_m > MOST_SIGMA_M:
        return f"its surfaces leave the motion open by {sigma_m:.2f} m"
    return ""


def _view_error(target: Pyramid, source: Pyramid) -> Float[np.ndarray, "6 6"]:
    """Covariance that distortion gives to a motion, which is no surer than that: (x, y, z, rotation vector)."""
    size = ViewErrorSize()
    for image in (target, source):
        size.add(image)
    return size.covariance


def _agree(there: Alignment, back: Alignment, bend: Float[np.ndarray, "6 6"]) -> bool:
    """Whether the motions of both directions are inverse to each other within their covariances and distortion."""
    round_trip = there.motion @ back.motion
    off = np.concatenate(
        [round_trip.position, Rotation.from_matrix(round_trip.rotation).as_rotvec()]
    )
    lever = np.eye(6)  # the first motion's rotation error turns what the second has come back
    lever[:3, 3:] = np.cross(there.motion.position, np.eye(3)).T
    turn = np.kron(np.eye(2), there.motion.rotation)
    covariance = lever @ there.covariance @ lever.T + turn @ back.covariance @ turn.T + 2.0 * bend
    return float(off @ np.linalg.solve(covariance, off)) <= BOTH_WAYS


def _in_link_order(found: Alignment, bend: Float[np.ndarray, "6 6"]) -> Float[np.ndarray, "6 6"]:
    """Covariance with distortion in the order and axes of a link: rotation first, axes of the second camera."""
    back = found.motion.rotation.T
    change = np.zeros((6, 6))
    change[:3, 3:], change[3:, :3] = back, back
    return np.asarray(change @ (found.covariance + bend) @ change.T)
