"""Other readings of given poses: by another convention, unit, clock or focal length the depth may fit better.

Depth images are compared as soon as the view has changed, each with the one before and with one some changes before.
For every reading of the poses it is counted how often it explains clearly more of the pixels than the poses as given.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from perception.primitives.camera import Camera
from perception.primitives.frame import DepthView
from perception.primitives.pose import CAMERA_IN_BODY_AXES, Pose3

from .poses import between

_WIDTH_PX = 160  # ours: of the images that are compared
_STEP_PX = 8  # ours: of the grid of compared pixels
_SAME = 0.03  # ours: share of the depth by which equal places may differ
_CHANGED = 0.7  # ours: the view has changed if so few of the pixels have the same depth
_CLEAR = 0.1  # ours: one of two explanations fits that much more of the pixels
_LEAST_SEEN = 0.2  # ours: share of the pixels that both images see
_BEFORE = (
    1,
    4,
)  # ours: changes of the view between compared images; by the farther one scale and clock show
_EXPLAINED = (
    0.5  # ours: poses with errors fit nothing, so that each of many readings may be a little better
)
_ENOUGH = 60  # ours: changes of the view; later ones are compared for a camera at rest alone
LEAST_PAIRS = 5  # ours: pairs of images that contradict the poses
PRONE = 3  # ours: times as many pairs as those that confirm them
_OFFSETS_S = (
    0.2,
    0.35,
    0.5,
    0.7,
    1.0,
)  # ours: of clocks; poses nearer by are means, of smaller errors
_FACTORS = (0.001, 0.01, 0.06, 0.12, 0.25, 0.35, 0.5, 0.7, 1.4, 2.0, 2.8, 4.0, 8.0, 16.0)  # ours
_SPACING_S = 0.2  # ours: of poses between which one is interpolated
IGNORE = "check their order, unit and direction, or leave them away: --ignore-poses"


@dataclass(frozen=True)
class Reading:
    """What the poses may be.

    Args:
        words: Completes "the depth fits better ...".
        advice: What to do.
        pose: The pose of the camera by a given one.
        later_s: By how much the stamps of the poses are later than those of the images.
        zoom: Factor of the focal length.
    """

    words: str
    advice: str
    pose: Callable[[Pose3], Pose3] = lambda pose: pose
    later_s: float = 0.0
    zoom: float = 1.0


def _turned(rotation: np.ndarray) -> Callable[[Pose3], Pose3]:
    return lambda pose: Pose3.from_rotation(pose.rotation @ rotation, pose.position)


def _mirrored(axis: int) -> Callable[[Pose3], Pose3]:
    flip = np.eye(3)
    flip[axis, axis] = -1.0
    return lambda pose: Pose3.from_rotation(flip @ pose.rotation @ flip, flip @ pose.position)


def _scaled(factor: float) -> Callable[[Pose3], Pose3]:
    return lambda pose: Pose3.from_rotation(pose.rotation, factor * pose.position)


def _with_scalar_last(pose: Pose3) -> Pose3:
    w, x, y, z = pose.quat_xyzw
    return Pose3(pose.translation, (x, y, z, w))


GIVEN = Reading("", "")
AT_REST = Reading("a camera at rest", IGNORE, lambda _: Pose3())
READINGS = (
    GIVEN,
    AT_REST,
    Reading(
        "their inverses", 'write convention = "world-to-camera", or invert them', Pose3.inverse
    ),
    Reading("quaternions in the order w, x, y, z", "write them as x, y, z, w", _with_scalar_last),
    *(
        Reading(
            f"camera axes of the kind {axes}", f'write axes = "{axes}" under [poses]', _turned(R)
        )
        for axes, R in (
            ("y-up", np.diag([1.0, -1.0, -1.0])),
            ("body", CAMERA_IN_BODY_AXES),
            ("optical", CAMERA_IN_BODY_AXES.T),
        )
    ),
    *(
        Reading(
            f"right-handed axes, with {axis} the other way",
            "convert the poses from left-handed axes",
            _mirrored(i),
        )
        for i, axis in enumerate("xyz")
    ),
    *(
        Reading(f"about {factor:.2g} times the positions", "give positions in m", _scaled(factor))
        for factor in _FACTORS
    ),
    *(
        Reading(
            f"stamps of the poses about {s:g} s {'earlier' if sign > 0 else 'later'}",
            "correct the offset of the clocks, or estimate the poses: --ignore-poses",
            later_s=sign * s,
        )
        for s in _OFFSETS_S
        for sign in (1, -1)
    ),
    *(
        Reading(
            f"about {zoom:.2g} times the focal length",
            "give the intrinsics of these images, in px",
            zoom=zoom,
        )
        for zoom in (0.5, 0.5**0.5, 2.0**0.5, 2.0)
    ),
)


@dataclass
class _Tally:
    """How one reading does against the poses as given."""

    better: int = 0
    worse: int = 0
    misfit: float = 0.0
    misfit_given: float = 0.0

    def add(self, share: float, given: float) -> None:
        self.better += share > given + _CLEAR
        self.worse += given > share + _CLEAR
        self.misfit += 1.0 - share
        self.misfit_given += 1.0 - given

    @property
    def fits(self) -> bool:
        """Whether this reading is better than the poses as given."""
        return self.better >= max(LEAST_PAIRS, PRONE * self.worse)

    @property
    def ratio(self) -> float:
        """Pixels that it does not explain, in those that the poses as given do not."""
        return self.misfit / self.misfit_given if self.misfit_given else math.inf


class PoseReadings:
    """Compares the readings, frame by frame; poses up to a second later are waited for."""

    def __init__(self) -> None:
        self.changes = 0
        """How often the view has changed between poses."""
        self._last: DepthView | None = None
        self._poses: deque[tuple[float, Pose3]] = deque()
        self._waiting: deque[tuple[float, DepthView]] = deque()
        self._before: deque[tuple[DepthView, list[Pose3 | None]]] = deque(maxlen=max(_BEFORE))
        self._tallies = [_Tally() for _ in READINGS]

    def add(self, stamp_s: float, pose: Pose3 | None, depth: DepthView | None) -> bool:
        """Take in a frame; whether its view has changed."""
        if pose is not None:
            self._poses.append((stamp_s, pose))
        changed = False
        if depth is not None:
            view = _thinned(depth)
            same = None if self._last is None else agreement(self._last, view, Pose3())
            changed = same is None or same <= _CHANGED
            self.changes += changed and same is not None and pose is not None
            if changed:
                self._last = view
            if changed and pose is not None:
                self._waiting.append((stamp_s, view))
        while self._waiting and self._waiting[0][0] + _OFFSETS_S[-1] <= stamp_s:
            self._compare(*self._waiting.popleft())
        oldest_s = self._waiting[0][0] if self._waiting else stamp_s
        while len(self._poses) > 2 and self._poses[1][0] < oldest_s - _OFFSETS_S[-1]:
            self._poses.popleft()
        return changed

    @property
    def better(self) -> tuple[Reading, int] | None:
        """The reading that fits clearly better than the poses as given, and in how many pairs; None if none does."""
        while self._waiting:
            self._compare(*self._waiting.popleft())
        found = [
            (one.ratio, one.better, reading)
            for reading, one in zip(READINGS, self._tallies, strict=True)
            if one.fits and (one.ratio < _EXPLAINED or reading is AT_REST)
        ]
        if not found:
            return None
        _, pairs, reading = min(found, key=lambda one: one[0])
        return reading, pairs

    def _compare(self, stamp_s: float, view: DepthView) -> None:
        readings = READINGS if self.changes <= _ENOUGH else READINGS[:2]
        poses = [
            None if given is None else reading.pose(given)
            for reading in readings
            for given in (self._at(stamp_s + reading.later_s, reading.later_s == 0.0),)
        ]
        for steps in _BEFORE:
            if steps > len(self._before):
                continue
            other, others = self._before[-steps]
            given: float | None = None
            for reading, tally, mine, theirs in zip(
                readings, self._tallies, poses, others, strict=False
            ):
                if mine is None or theirs is None:
                    continue
                T_other_one = theirs.inverse() @ mine
                share = agreement(
                    _zoomed(other, reading.zoom), _zoomed(view, reading.zoom), T_other_one
                )
                if reading is GIVEN:
                    given = share
                if given is None:
                    break
                if share is not None:
                    tally.add(share, given)
        self._before.append((view, poses))

    def _at(self, stamp_s: float, exact: bool) -> Pose3 | None:
        """The pose at an instant; None without poses nearby."""
        stamps = [one for one, _ in self._poses]
        after = int(np.searchsorted(stamps, stamp_s))
        if after < len(stamps) and stamps[after] == stamp_s:
            return self._poses[after][1]
        if exact or not 0 < after < len(stamps):
            return None
        (first_s, first), (second_s, second) = self._poses[after - 1], self._poses[after]
        if second_s - first_s > _SPACING_S:
            return None
        return between(first, second, (stamp_s - first_s) / (second_s - first_s))


def agreement(other: DepthView, one: DepthView, T_other_one: Pose3) -> float | None:
    """Share of the pixels seen by two cameras whose depths agree; None if these pixels are few."""
    z = one.depth[::_STEP_PX, ::_STEP_PX]
    rays = one.camera.rays[::_STEP_PX, ::_STEP_PX]
    valid = np.isfinite(z)
    points = (rays[valid] * z[valid][:, None]) @ T_other_one.rotation.T + T_other_one.position
    ahead = points[points[:, 2] > 0.05]
    with np.errstate(all="ignore"):  # poses may be absurd
        inside, u, v = other.camera.nearest_pixels(ahead)
    seen = other.depth[v[inside], u[inside]]
    expected = ahead[inside, 2]
    both = np.isfinite(seen)
    if both.sum() < max(_LEAST_SEEN * len(points), 20):
        return None
    return float(np.mean(np.abs(seen - expected)[both] < _SAME * expected[both]))


def _thinned(view: DepthView) -> DepthView:
    step = max(1, round(view.camera.width / _WIDTH_PX))
    return DepthView(view.depth[::step, ::step].copy(), _camera(view.camera, step, 1.0))


def _zoomed(view: DepthView, zoom: float) -> DepthView:
    return view if zoom == 1.0 else DepthView(view.depth, _camera(view.camera, 1, zoom))


@cache
def _camera(camera: Camera, step: int, zoom: float) -> Camera:
    """The camera of every so many pixels, with another focal length."""
    return replace(
        camera,
        width=math.ceil(camera.width / step),
        height=math.ceil(camera.height / step),
        fx=zoom * camera.fx / step,
        fy=zoom * camera.fy / step,
        cx=camera.cx / step,
        cy=camera.cy / step,
    )
