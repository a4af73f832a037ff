"""Conversion of our factors to GTSAM's; the only module that creates GTSAM factors.

All factors are compiled ones of GTSAM; a factor in Python would take five times as long. Where GTSAM has no
suitable factor, auxiliary poses express it. A head with play is a pose of its own, rotated against the body. A
systematic error is a velocity in GTSAM's white-noise-on-acceleration factor, by which one pose follows from
another at a velocity over a time, and the velocity hardly changes: the pose by odometry moves at the velocity
"slip" for as many units as there were steps.

GTSAM expresses perturbations of a pose in the pose's own axes, on the floor as (x, y, yaw), in space with the
rotation first; covariances are converted to those axes, and back.

Source: Dellaert and Kaess, "Factor Graphs for Robot Perception" (2017); velocity factor: Barfoot, Tong,
Särkkä, "Batch continuous-time trajectory estimation as exactly sparse Gaussian process regression" (2014);
systematic errors by it are ours.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import gtsam
import numpy as np
from jaxtyping import Float

from ..primitives.errors import InputError
from ..primitives.gaussian import Gaussian
from ..primitives.pose import Pose2, Pose3
from .factors import (
    WIDTHS,
    Effect,
    Factor,
    FloorSeen,
    Glance,
    LandmarkSeen,
    LoopClosure,
    Loss,
    Motion,
    Placement,
    PoseSeen,
    Systematic,
    poses_of,
    turned_covariance,
)

TIGHT = 1e-5  # m and rad: negligible, and well conditioned
SETTLED = 1e-3  # least change of a systematic error between two effects, in its sigma, likewise
ABSENT = 1e-4  # sigma of an absent systematic error: m and rad per unit


class Graph:
    """New GTSAM factors with initial values of their variables; `take` returns them.

    GTSAM keys by letter: x poses, l landmarks, m auxiliary poses, s systematic errors, f floor.
    """

    def __init__(self, systematics: Sequence[Systematic] = ()) -> None:
        self._systematics = {one.name: one for one in systematics}
        self._chain: dict[str, tuple[int, Any]] = {}  # latest variable, initial value
        self._landmarks: dict[int, Any] = {}
        self._count = 0
        self._floor = False
        self._reset()

    def _reset(self) -> None:
        self.factors = gtsam.NonlinearFactorGraph()
        self.values = gtsam.Values()
        self.passing: list[int] = []  # variables of this instant, which may be marginalised later
        self.robust: list[int] = []  # indices of factors with a loss that may be rejected
        self._guesses: dict[int, Any] = {}

    def take(self) -> tuple[Any, Any, list[int]]:
        """New factors, initial values, and the variables of this instant; then start over."""
        taken = self.factors, self.values, self.passing
        self._reset()
        return taken

    @property
    def systematic_keys(self) -> dict[str, int]:
        """Latest variable of each systematic error so far."""
        return {name: key for name, (key, _) in self._chain.items()}

    @property
    def landmark_keys(self) -> dict[int, int]:
        """Variable of each estimated landmark."""
        return {number: int(gtsam.symbol("l", number)) for number in self._landmarks}

    @property
    def lasting(self) -> list[int]:
        """Variables of no single instant: current systematic errors, landmarks, the floor."""
        floor = [int(gtsam.symbol("f", i)) for i in range(2 if self._floor else 0)]
        return [*self.systematic_keys.values(), *self.landmark_keys.values(), *floor]

    def add_pose(self, number: int, guess: Pose2 | Pose3) -> None:
        """Add a pose with its initial value."""
        key = pose_key(number)
        native = to_native(guess)
        self.values.insert(key, native)
        self._guesses[key] = native
        self.passing.append(key)

    def recall_pose(self, number: int, guess: Pose2 | Pose3) -> None:
        """Set the current estimate of an earlier pose."""
        self._guesses[pose_key(number)] = to_native(guess)

    def add(self, factor: Factor) -> None:
        """Add one measurement of poses that were added before."""
        if isinstance(factor, Motion):
            self._motion(factor)
        elif isinstance(factor, LoopClosure):
            noise = self._noise(local_covariance(factor.covariance, factor.motion), factor.loss)
            self._between(
                pose_key(factor.before), pose_key(factor.after), to_native(factor.motion), noise
            )
        elif isinstance(factor, PoseSeen):
            self._pose_seen(factor)
        elif isinstance(factor, Glance):
            self._glance(factor)
        else:
            self._floor_seen(factor)

    def _motion(self, factor: Motion) -> None:
        after = pose_key(factor.after)
        motion = to_native(factor.motion)
        noise = self._noise(local_covariance(factor.covariance, factor.motion), factor.loss)
        here = pose_key(factor.before)
        if factor.effects:
            end = self._new_pose(self._guesses[here].compose(motion))
            self._between(here, end, motion, noise)
            for effect in factor.effects[:-1]:
                end = self._affected(end, effect)
            self._affected(end, factor.effects[-1], after)
        else:
            self._between(here, after, motion, noise)

    def _pose_seen(self, factor: PoseSeen) -> None:
        if isinstance(factor.place, Gaussian):
            x, y, yaw = (float(v) for v in factor.place.mean)
            pose: Pose2 | Pose3 = Pose2(x, y, yaw)
        else:
            pose = factor.place.pose
        noise = self._noise(local_covariance(factor.place.covariance, pose), factor.loss)
        kind = gtsam.PriorFactorPose2 if isinstance(pose, Pose2) else gtsam.PriorFactorPose3
        self.factors.add(kind(pose_key(factor.pose), to_native(pose), noise))

    def _glance(self, factor: Glance) -> None:
        head = pose_key(factor.pose)
        if factor.play_rad > 0.0:
            head = self._rotated(head, 0.0, factor.play_rad)
        for effect in factor.effects:
            head = self._affected(head, effect)
        for one in factor.seen:
            self._landmark(head, one)

    def _landmark(self, head: int, one: LandmarkSeen) -> None:
        distance, bearing = (float(v) for v in one.measured)
        eye = head
        if one.effects:  # an error along the ray needs a pose in that direction
            eye = self._rotated(head, bearing, TIGHT)
            for effect in one.effects:
                eye = self._affected(eye, effect)
            bearing = 0.0
        if isinstance(one.landmark, tuple):
            c, s = math.cos(bearing), math.sin(bearing)
            out = np.array([[c, -distance * s], [s, distance * c]])
            noise = self._noise(out @ one.covariance @ out.T, one.loss)
            measured = np.array([distance * c, distance * s])
            place = np.array(one.landmark)
            self.factors.add(gtsam.KnownLandmarkFactorPose2(eye, place, measured, noise))
            return
        key = gtsam.symbol("l", one.landmark)
        if one.landmark not in self._landmarks:
            ray = distance * np.array([math.cos(bearing), math.sin(bearing)])
            self._landmarks[one.landmark] = guess = self._guesses[eye].transformFrom(ray)
            self.values.insert(key, guess)
        swapped = one.covariance[::-1, ::-1].copy()  # GTSAM: bearing first
        noise = self._noise(swapped, one.loss, needed=True)
        self.factors.add(gtsam.BearingRangeFactor2D(eye, key, gtsam.Rot2(bearing), distance, noise))

    def _floor_seen(self, factor: FloorSeen) -> None:
        floor = gtsam.symbol("f", 0)
        if not self._floor:
            self._floor = True
            anchor = gtsam.symbol("f", 1)
            firm = gtsam.noiseModel.Isotropic.Sigma(6, TIGHT)
            level = gtsam.noiseModel.Isotropic.Sigma(3, TIGHT)
            self.values.insert(anchor, gtsam.Pose3())
            self.values.insert(floor, gtsam.OrientedPlane3(0.0, 0.0, 1.0, 0.0))
            self.factors.add(gtsam.PriorFactorPose3(anchor, gtsam.Pose3(), firm))
            upright = np.array([0.0, 0.0, 1.0, 0.0])
            self.factors.add(gtsam.OrientedPlane3Factor(upright, level, anchor, floor))
        # GTSAM's plane factor takes neither a loss nor an anisotropic covariance. So an auxiliary pose
        # observes the floor exactly, and its deviation from the pose has the floor's covariance: tilts
        # rotate it, the offset lifts it.
        plane = factor.plane
        n, (first, second) = plane.normal, plane.tangents
        away = np.zeros((6, 3))
        away[:3, 0], away[:3, 1], away[3:, 2] = np.cross(n, first), np.cross(n, second), -n
        covariance = away @ plane.covariance @ away.T + TIGHT**2 * np.eye(6)
        here = pose_key(factor.pose)
        eye = self._new_pose(self._guesses[here])
        noise = self._noise(covariance, factor.loss, needed=True)
        self._between(here, eye, gtsam.Pose3(), noise)
        exact = gtsam.noiseModel.Isotropic.Sigma(3, TIGHT)
        measured = np.append(n, plane.offset_m)
        self.factors.add(gtsam.OrientedPlane3Factor(measured, exact, eye, floor))

    def _rotated(self, here: int, turn_rad: float, sigma_rad: float) -> int:
        """A rotated pose at the same position."""
        turn = gtsam.Pose2(0.0, 0.0, turn_rad)
        there = self._new_pose(self._guesses[here].compose(turn))
        sigmas = np.array([TIGHT, TIGHT, max(sigma_rad, TIGHT)])
        self._between(here, there, turn, gtsam.noiseModel.Diagonal.Sigmas(sigmas))
        return there

    def _affected(self, here: int, effect: Effect, there: int | None = None) -> int:
        """The pose after a systematic error."""
        if effect.name not in self._systematics:
            raise InputError(
                f"effect of {effect.name!r}: there is no such systematic error; "
                f"known are {sorted(self._systematics) or 'none'}"
            )
        error = self._systematics[effect.name]
        sigma = np.where(error.sigma > 0.0, error.sigma, ABSENT)
        if effect.name not in self._chain:
            key = self._new_error(error.mean)
            prior = gtsam.noiseModel.Diagonal.Sigmas(sigma)
            self.factors.add(gtsam.PriorFactorPoint3(key, error.mean, prior))
            self._chain[effect.name] = (key, error.mean)
        latest, guess = self._chain[effect.name]
        if there is None:
            there = self._new_pose(self._guesses[here].compose(_exponential(guess * effect.scale)))
        following = self._new_error(guess)
        least = np.where(error.sigma > 0.0, SETTLED, 0.1) * sigma
        change = np.maximum(error.walk**2 * effect.elapsed, least**2)
        states = (
            gtsam.StateData(here, latest, 0.0),
            gtsam.StateData(there, following, effect.scale),
        )
        self.factors.add(gtsam.WnoaMotionFactorPose2(*states, change / effect.scale))
        self.passing.append(latest)
        self._chain[effect.name] = (following, guess)
        return there

    def _new_pose(self, guess: Any) -> int:
        self._count += 1
        key = int(gtsam.symbol("m", self._count))
        self.values.insert(key, guess)
        self._guesses[key] = guess
        self.passing.append(key)
        return key

    def _new_error(self, guess: Float[np.ndarray, "3"]) -> int:
        self._count += 1
        key = int(gtsam.symbol("s", self._count))
        self.values.insertPoint3(key, guess)
        return key

    def _between(self, here: int, there: int, motion: Any, noise: Any) -> None:
        planar = isinstance(motion, gtsam.Pose2)
        kind = gtsam.BetweenFactorPose2 if planar else gtsam.BetweenFactorPose3
        self.factors.add(kind(here, there, motion, noise))

    def _noise(self, covariance: Float[np.ndarray, "d d"], loss: Loss, needed: bool = False) -> Any:
        """Noise of the next factor; a needed one keeps its loss and is never rejected."""
        noise = gtsam.noiseModel.Gaussian.Covariance(covariance)
        if loss.kind == "none":
            return noise
        if not needed:
            self.robust.append(self.factors.size())
        estimators = gtsam.noiseModel.mEstimator
        kind: Any = {"huber": estimators.Huber, "cauchy": estimators.Cauchy}[loss.kind]
        width = loss.width or WIDTHS[loss.kind]
        return gtsam.noiseModel.Robust.Create(kind.Create(width), noise)


def pose_key(number: int) -> int:
    """GTSAM's key of a pose."""
    return int(gtsam.symbol("x", number))


def to_native(pose: Pose2 | Pose3) -> Any:
    """To GTSAM's type."""
    if isinstance(pose, Pose2):
        return gtsam.Pose2(pose.x, pose.y, pose.yaw)
    return gtsam.Pose3(pose.matrix)


def from_native(native: Any) -> Pose2 | Pose3:
    """From GTSAM's type."""
    if isinstance(native, gtsam.Pose2):
        return Pose2(native.x(), native.y(), native.theta())
    return Pose3.from_matrix(native.matrix())


def local_covariance(
    covariance: Float[np.ndarray, "d d"], pose: Pose2 | Pose3
) -> Float[np.ndarray, "d d"]:
    """From the axes that the pose is given in to its own, in GTSAM's order."""
    local = turned_covariance(covariance, pose.rotation.T)
    return local if isinstance(pose, Pose2) else _swapped(local)


def marginal(native: Any, covariance: Float[np.ndarray, "d d"]) -> Gaussian | Placement:
    """From GTSAM's pose and marginal covariance, in world axes and our order."""
    pose = from_native(native)
    if isinstance(pose, Pose2):
        turned = turned_covariance(covariance, pose.rotation)
        return Gaussian(pose.vector, (turned + turned.T) / 2.0)
    turned = turned_covariance(_swapped(covariance), pose.rotation)
    return Placement(pose, (turned + turned.T) / 2.0)


def first_guesses(
    factors: Sequence[Factor], known: Mapping[int, Pose2 | Pose3]
) -> dict[int, Pose2 | Pose3]:
    """Initial values of all poses of the factors, along motions from the known ones.

    Raises:
        InputError: A pose is not connected.
    """
    guesses = dict(known)
    for factor in factors:
        if isinstance(factor, PoseSeen) and factor.pose not in guesses:
            place = factor.place
            guesses[factor.pose] = (
                Pose2(*(float(v) for v in place.mean))
                if isinstance(place, Gaussian)
                else place.pose
            )
    # Motions first: a loop closure may be false. Measured poses may be false too, but anchor the rest.
    for kind in (Motion, (Motion, LoopClosure)):
        rest: list[Motion | LoopClosure] = [f for f in factors if isinstance(f, kind)]
        while rest:
            left = [one for one in rest if not _reach(one, guesses)]
            if len(left) == len(rest):
                break
            rest = left
    for number in (number for factor in factors for number in poses_of(factor)):
        if number not in guesses:
            raise InputError(
                f"pose {number} is not connected to a known pose; give the motion that leads to it, "
                "or a measured pose"
            )
    return guesses


def _reach(one: Motion | LoopClosure, guesses: dict[int, Any]) -> bool:
    """Whether both ends are known, after adding the one that follows from the other."""
    if one.before in guesses and one.after not in guesses:
        guesses[one.after] = guesses[one.before] @ one.motion
    elif one.after in guesses and one.before not in guesses:
        guesses[one.before] = guesses[one.after] @ one.motion.inverse()
    return one.before in guesses


def _exponential(motion: Float[np.ndarray, "3"]) -> Any:
    """The pose reached in one second at a velocity (ahead, left, turn)."""
    return gtsam.Pose2.Expmap(motion)


def _swapped(covariance: Float[np.ndarray, "6 6"]) -> Float[np.ndarray, "6 6"]:
    """Rotation and translation exchanged."""
    order = [3, 4, 5, 0, 1, 2]
    return np.asarray(covariance[np.ix_(order, order)])
