"""Where am I without any marker: what is seen now against what was seen from former viewpoints.

Fronts of walls and furniture (`scan`) are laid over those of the keyframes, place by place along the
partner's normal. What comes out is not a pose but what the overlap really tells: the normal equations of
pose and keyframes together, of which directions without evidence (along a single wall, round a pillar) are
left out. Keyframes are former viewpoints of the walker and stay part of the belief (`keyframes`), so that
no place is counted twice and closing a loop mends the way between.

A scan as a whole stands a little beside the pose it was taken from: the trunk trembles, the neck has play,
ranges err alike. That is noise of the viewpoint, new with every scan; a keyframe keeps its own.

Source: point to line, Censi 2008; robust weights, Cauchy; the joint belief: see `keyframes`. Ours: the rest.
"""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from ..filtering import models
from ..filtering.consistency import chi_square_quantile
from ..filtering.models import DRIFT, LATERAL_SLIP, PAN, SLIP, TURN, WALKER_SIZE, YAW, X, Y
from ..primitives.frame import StepOdometry
from ..primitives.gaussian import Gaussian
from ..primitives.pose import Pose2, wrap_angle
from . import _registration_kernels as kernels
from .filter import LocaliserConfig, process_noise
from .keyframes import POSE, Viewpoints
from .registration_config import RegistrationConfig as RegistrationConfig
from .scan import Scan

log = logging.getLogger(__name__)

APPARENT = np.zeros((POSE, WALKER_SIZE))
"""The pose that a scan seems to be taken from, by the walker's state: a head that makes all bearings too
large by PAN seems to stand on a body turned back by as much."""
APPARENT[0, X] = APPARENT[1, Y] = APPARENT[2, YAW] = 1.0
APPARENT[2, PAN] = -1.0

ARM_M = 1.5
"""To a typical place, by which an error of heading displaces it."""


@dataclass(frozen=True)
class RegistrationReport:
    """What became of one scan.

    Args:
        outcome: "used", "new" (nothing to compare with: it became a keyframe), "poor" (too few places, or
            too few partners), "rough" (no pose fits) or "gate" (fits, but elsewhere than can be).
        partners: Places that found one.
        nis: Normalised innovation squared, chi-square with `degrees` degrees of freedom if consistent.
        degrees: Directions in which something was learnt, of pose and keyframes together.
        keyframes: Remembered now.
    """

    outcome: str
    partners: int = 0
    nis: float = 0.0
    degrees: int = 0
    keyframes: int = 0


class Registration:
    """The map of keyframes, and what it says of the walker."""

    def __init__(self, config: RegistrationConfig | None = None) -> None:
        self.config = config or RegistrationConfig()
        self.viewpoints = Viewpoints(WALKER_SIZE)
        self._scans: list[Scan] = []
        self._circles: list[tuple[float, float, float]] = []  # about each scan, its own frame
        self._used: list[int] = []  # when each was of use
        self._count = 0
        self._rejected = 0

    def moved(
        self,
        localiser: LocaliserConfig,
        before: Gaussian,
        odometry: StepOdometry | None,
        dt: float,
        after: Gaussian,
    ) -> None:
        """The walker's filter has predicted.

        Args:
            localiser: Its noise figures.
            before, after: Its state.
            odometry: What it was given.
            dt: Likewise, s.
        """
        F, predicted = motion(localiser, before, odometry, dt)
        self.viewpoints.moved(before, F, predicted, after)

    def learnt(self, before: Gaussian, after: Gaussian) -> None:
        """The walker's filter has learnt from landmarks."""
        self.viewpoints.learnt(before, after)

    def register(
        self,
        state: Gaussian,
        scan: Scan,
        heading_rad: float = 0.0,
        anchored: bool = False,
        shift: Float[np.ndarray, "3"] | None = None,
    ) -> tuple[Gaussian, RegistrationReport]:
        """Lay a scan over the map, learn from it, and perhaps remember it.

        Args:
            state: The walker's, entries as in `models`.
            scan: Body frame.
            heading_rad: Of the sensor in the body frame: ahead and aside are told of it.
            anchored: Whether landmarks agree with the state: if the map contradicts it, the map is wrong.
            shift: How far, one deviation, the scan may be off along the motion (x, y, yaw) of the body,
                body frame, because clocks differ; None: not at all.

        Returns:
            The state after it (the same if nothing was learnt), and what became of the scan.
        """
        self._count += 1
        if len(scan) < self.config.least_places:
            return state, self._report("poor")
        self.viewpoints.add(state, APPARENT, self._noise(state, heading_rad, shift))
        state, report, covered = self._compare(state, scan)
        fresh = report.outcome == "new" or (
            report.outcome == "used" and covered < self.config.new_share
        )
        if report.outcome in ("rough", "gate"):
            state = self._contradicted(state, anchored)
        elif report.outcome == "used":
            self._rejected = 0
        if fresh and self._rejected == 0:
            self._scans.append(scan)
            middle, radius = _circle(scan)
            self._circles.append((float(middle[0]), float(middle[1]), radius))
            self._used.append(self._count)
            self._forget_oldest()
        else:
            self.viewpoints.drop(-1)
        return state, self._report(report.outcome, report)

    def _noise(
        self, state: Gaussian, heading_rad: float, shift: Float[np.ndarray, "3"] | None
    ) -> Float[np.ndarray, "3 3"]:
        """Of a viewpoint: how far a whole scan stands beside its pose."""
        c, s = math.cos(state.mean[YAW] + heading_rad), math.sin(state.mean[YAW] + heading_rad)
        R = np.array([[c, -s], [s, c]])
        own = np.array([self.config.ahead_sigma_m, self.config.aside_sigma_m]) ** 2
        noise = np.zeros((POSE, POSE))
        noise[:2, :2] = R @ np.diag(own) @ R.T
        noise[2, 2] = self.config.turn_sigma_rad**2
        if shift is not None:
            x, y = Pose2(yaw=float(state.mean[YAW])).rotation @ shift[:2]
            moved = np.array([x, y, shift[2]])
            noise += np.outer(moved, moved)
        return noise

    def _compare(self, state: Gaussian, scan: Scan) -> tuple[Gaussian, RegistrationReport, float]:
        """Learn from the last viewpoint, where the scan was taken; also the share of places known."""
        config = self.config
        if not self._scans:
            return state, RegistrationReport("new"), 0.0
        chosen, gate, known = self._overlapping(state, scan)
        if not chosen:
            return state, RegistrationReport("new" if self._rejected == 0 else "gate"), 0.0
        fit = self._fit(state, scan, chosen, gate)
        share = fit.partners / len(scan)
        if known >= config.known_share and share < config.fitting_share * known:
            return state, RegistrationReport("rough", fit.partners), share  # it stands, but not so
        if fit.partners < config.least_places or share < config.least_share:
            outcome = "new" if self._rejected == 0 else "poor"
            return state, RegistrationReport(outcome, fit.partners), share
        if fit.roughness > config.rough_m**2:
            return state, RegistrationReport("rough", fit.partners), share
        indices = [len(self.viewpoints) - 1, *chosen]
        S = self.viewpoints.innovation_covariance(state, indices, fit.H)
        nis = float(fit.innovation @ np.linalg.solve(S, fit.innovation))
        degrees = len(fit.H)
        if nis > chi_square_quantile(config.gate_probability, degrees):
            return state, RegistrationReport("gate", fit.partners, nis, degrees), share
        for j in chosen:
            self._used[j] = self._count
        state = self.viewpoints.learn(state, indices, fit.H, fit.innovation)
        return state, RegistrationReport("used", fit.partners, nis, degrees), share

    def _overlapping(self, state: Gaussian, scan: Scan) -> tuple[list[int], float, float]:
        """Keyframes with most partners, best first; how far a partner may be, m; share of places known."""
        config, last = self.config, len(self.viewpoints) - 1
        level = scan.at(_pose2(self.viewpoints.pose(last)))
        near = self._within_reach(level)
        if not near:
            return [], config.gate_m, 0.0
        gate = min(config.gate_m + 3.0 * self._relative_sigma(state, near), config.widest_gate_m)
        map_scan, first, _ = self._map(near)
        found = self._partners(level, map_scan, first, config.widest_gate_m)
        counts = np.sum(found >= 0, axis=0)
        order = np.argsort(-counts, kind="stable")[: config.together]
        chosen = [near[j] for j in order if 2 * counts[j] >= config.least_places]
        return chosen, gate, float(np.mean(np.any(found >= 0, axis=1)))

    def _within_reach(self, level: Scan) -> list[int]:
        """Keyframes that can have seen what is seen now, by circles about both."""
        middle, radius = _circle(level)
        poses = self.viewpoints.mean.reshape(-1, POSE)[:-1]
        local = np.array(self._circles)
        c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
        x = poses[:, 0] + c * local[:, 0] - s * local[:, 1] - middle[0]
        y = poses[:, 1] + s * local[:, 0] + c * local[:, 1] - middle[1]
        reach = local[:, 2] + radius + self.config.gate_m
        return [int(j) for j in np.flatnonzero(x * x + y * y < reach * reach)]

    def _relative_sigma(self, state: Gaussian, near: list[int]) -> float:
        """How far partners may be apart because viewpoint and keyframes are not known, one deviation, m.

        Of the keyframe that hangs together with the viewpoint best.
        """
        P = self.viewpoints.covariance(state, [*near, len(self.viewpoints) - 1])
        own, across = (
            np.diag(P).reshape(-1, POSE),
            np.stack([P[k::POSE, P.shape[0] - POSE + k] for k in range(POSE)], axis=1),
        )
        relative = np.maximum(own[:-1] + own[-1] - 2.0 * across[:-1], 0.0)
        return float(np.sqrt(np.min(relative[:, 0] + relative[:, 1] + ARM_M**2 * relative[:, 2])))

    def _map(self, chosen: list[int]) -> tuple[Scan, Int[np.ndarray, "k1"], np.ndarray]:
        """The scans of some keyframes in the world, where each begins, and their poses (k, 3)."""
        poses = np.array([self.viewpoints.pose(j) for j in chosen])
        scans = [self._scans[j].at(_pose2(pose)) for j, pose in zip(chosen, poses, strict=True)]
        first = np.concatenate([[0], np.cumsum([len(one) for one in scans])]).astype(np.int64)
        whole = Scan(
            np.concatenate([one.places for one in scans]),
            np.concatenate([one.normals for one in scans]),
            np.concatenate([one.sigmas for one in scans]),
        )
        return whole, first, poses

    def _partners(
        self, level: Scan, map_scan: Scan, first: Int[np.ndarray, "k1"], gate: float
    ) -> Int[np.ndarray, "n k"]:
        found = np.empty((len(level), len(first) - 1), np.int64)
        cosine = math.cos(math.radians(self.config.facing_deg))
        kernels.partners(
            level.places,
            level.normals,
            map_scan.places,
            map_scan.normals,
            first,
            gate,
            cosine,
            found,
        )
        return found

    def _fit(self, state: Gaussian, scan: Scan, chosen: list[int], gate: float) -> _Fit:
        """Partners and pose in turn, the keyframes held; then what the last partners say of all."""
        config, last = self.config, len(self.viewpoints) - 1
        map_scan, first, poses = self._map(chosen)
        prior = self.viewpoints.pose(last).copy()
        trust = self._given_keyframes(state, chosen)
        now = prior.copy()
        size = POSE * (1 + len(chosen))
        A, b = np.empty((size, size)), np.empty(size)
        used, roughness = 0, math.inf
        for turn in range(config.rounds):
            level = scan.at(_pose2(now))
            reach = max(config.gate_m, gate * 0.6**turn)
            found = self._partners(level, map_scan, first, reach)
            used, roughness = kernels.accumulate(
                level.places,
                level.sigmas,
                now,
                map_scan.places,
                map_scan.normals,
                map_scan.sigmas,
                first,
                poses,
                found,
                config.outlier_sigmas if reach <= config.gate_m else 3.0 * config.outlier_sigmas,
                A,
                b,
            )
            A /= config.alike
            b /= config.alike
            back = _difference(prior, now)
            step = np.linalg.solve(A[:POSE, :POSE] + trust, b[:POSE] + trust @ back)
            settled = reach <= config.gate_m and float(np.max(np.abs(step))) < 2e-4
            if settled or turn == config.rounds - 1:
                break
            now = now + step
        moved = b + A[:, :POSE] @ _difference(now, prior)
        values, vectors = np.linalg.eigh(A)
        told = values > 1e-6 * max(float(values[-1]), 1.0)
        root = np.sqrt(values[told])
        H = root[:, None] * vectors[:, told].T
        return _Fit(used, roughness, H, (vectors[:, told].T @ moved) / root)

    def _given_keyframes(self, state: Gaussian, chosen: list[int]) -> Float[np.ndarray, "3 3"]:
        """Information on the last viewpoint if these keyframes were known exactly."""
        P = self.viewpoints.covariance(state, [*chosen, len(self.viewpoints) - 1])
        across = P[:-POSE, -POSE:]
        given = P[-POSE:, -POSE:] - across.T @ np.linalg.solve(
            P[:-POSE, :-POSE] + 1e-10 * np.eye(len(across)), across
        )
        return np.asarray(np.linalg.inv(models.positive(given) + 1e-10 * np.eye(POSE)))

    def _contradicted(self, state: Gaussian, anchored: bool) -> Gaussian:
        """Several times in a row: either the map is wrong, or the walker was carried elsewhere."""
        self._rejected += 1
        if self._rejected < self.config.doubt_after:
            return state
        self._rejected = 0
        if anchored:
            log.info("the map contradicts the landmarks: %d keyframes dropped", len(self._scans))
            while self._scans:
                self._drop(0)
            return state
        log.info("nothing fits where it should: pose doubted")
        self.viewpoints.part(state)
        P = np.array(state.covariance)
        P[[X, Y], [X, Y]] += self.config.doubt_m**2
        P[YAW, YAW] += self.config.doubt_rad**2
        return Gaussian(state.mean, P)

    def _forget_oldest(self) -> None:
        """Of too many keyframes the one that was of no use for longest."""
        if len(self._scans) > self.config.most_keyframes:
            self._drop(int(np.argmin(self._used)))

    def _drop(self, index: int) -> None:
        del self._scans[index], self._circles[index], self._used[index]
        self.viewpoints.drop(index)

    def _report(self, outcome: str, found: RegistrationReport | None = None) -> RegistrationReport:
        if found is None:
            return RegistrationReport(outcome, keyframes=len(self._scans))
        return RegistrationReport(
            outcome, found.partners, found.nis, found.degrees, len(self._scans)
        )


@dataclass(frozen=True)
class _Fit:
    """Partners found, mean squared residual, and the measurement H (now, keyframes) with unit noise."""

    partners: int
    roughness: float
    H: Float[np.ndarray, "z r"]
    innovation: Float[np.ndarray, "z"]


def motion(
    config: LocaliserConfig, before: Gaussian, odometry: StepOdometry | None, dt: float
) -> tuple[Float[np.ndarray, "10 10"], Gaussian]:
    """The walker's motion to first order: its Jacobian, and the state after it.

    Args:
        config: Noise of walking.
        before: State, entries as in `models`.
        odometry: As given to the filter.
        dt: Likewise, s.
    """
    blind = odometry is None or not (
        bool(np.all(np.isfinite(odometry.motion.vector))) and math.isfinite(odometry.steps)
    )
    made = Pose2() if blind or odometry is None else odometry.motion
    steps = 0.0 if blind or odometry is None else abs(odometry.steps)
    dt = max(dt, 0.0) if math.isfinite(dt) else 0.0
    x = before.mean
    c, s = math.cos(x[YAW]), math.sin(x[YAW])
    ahead, left = made.x + x[SLIP] * steps, made.y + x[LATERAL_SLIP] * steps
    F = np.eye(WALKER_SIZE)
    F[X, YAW], F[Y, YAW] = -s * ahead - c * left, c * ahead - s * left
    F[X, SLIP], F[Y, SLIP] = c * steps, s * steps
    F[X, LATERAL_SLIP], F[Y, LATERAL_SLIP] = -s * steps, c * steps
    F[YAW, DRIFT] = F[TURN, DRIFT] = steps
    F[TURN, TURN] = 0.0
    Q = process_noise(config, float(x[YAW]), steps, dt, blind)
    return F, Gaussian(
        models.walk(x, dt, made, steps), models.positive(F @ before.covariance @ F.T + Q)
    )


def _pose2(vector: Float[np.ndarray, "3"]) -> Pose2:
    x, y, yaw = (float(v) for v in vector)
    return Pose2(x, y, yaw)


def _circle(scan: Scan) -> tuple[Float[np.ndarray, "2"], float]:
    """Middle and radius of a circle about all places."""
    middle = (scan.places.min(axis=0) + scan.places.max(axis=0)) / 2.0
    return middle, float(np.sqrt(np.max(np.sum((scan.places - middle) ** 2, axis=1))))


def _difference(a: Float[np.ndarray, "3"], b: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    difference = a - b
    difference[2] = wrap_angle(float(difference[2]))
    return np.asarray(difference)
