"""Scan registration with keyframes: localisation without landmarks.

The current scan is aligned with those of the keyframes (`scan_alignment`). The result is not a pose but the
information in the overlap, on the current pose and the keyframes together. Keyframe poses stay part of the joint
estimate (`keyframes`), so no point is counted twice, and closing a loop corrects the trajectory between.

Each scan as a whole has an error: sway of the trunk, play of the neck, and a common range error. It is noise of
the sensor pose, independent for every scan; a keyframe keeps its own.

Source: alignment: see `scan_alignment`; joint estimate: see `keyframes`. The rest is ours.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..filtering import models
from ..filtering.consistency import chi_square_quantile
from ..filtering.models import PAN, WALKER_SIZE, YAW, X, Y
from ..primitives.errors import ConfigError
from ..primitives.frame import StepOdometry
from ..primitives.gaussian import Gaussian
from ..primitives.pose import Pose2
from ..primitives.settings import setting
from . import scan_search
from .keyframes import POSE_SIZE, KeyframePoses
from .localiser_noise import linearised_motion
from .noise_factor import NoiseFactor
from .scan import Scan, joined
from .scan_alignment import GATE_M, KeyframeScans, align

log = logging.getLogger(__name__)

SENSOR_POSE = np.zeros((POSE_SIZE, WALKER_SIZE))
"""Pose from which a scan seems to be taken, by the state: a pan offset, which makes all bearings too large, looks
like a body turned back by the same angle."""
SENSOR_POSE[0, X] = SENSOR_POSE[1, Y] = SENSOR_POSE[2, YAW] = 1.0
SENSOR_POSE[2, PAN] = -1.0

ARM_M = 1.5  # ours: distance of a typical point, which an error of heading displaces
AHEAD_SIGMA_M = 0.0045  # walking trials: trunk pitch of .5 deg, 0.38 m up; 3 mm of range
LATERAL_SIGMA_M = 0.005  # walking trials: trunk roll of .72 deg, likewise
TURN_SIGMA_RAD = math.radians(0.4)  # walking trials: play of the neck
WIDEST_GATE_M = 0.40  # ours: the same for the most uncertain pose
LEAST_NIS = 0.6  # ours: per degree of freedom; below, scans as a whole are claimed too uncertain
TOGETHER = 4  # ours: keyframes used at once, those with most correspondences
LEAST_POINTS = 12  # ours: with correspondences; fewer say nothing
LEAST_SHARE = 0.3  # ours: of points with correspondences; fewer is another place
KNOWN_SHARE = 0.6  # ours: from this share within the widest gate on the place is not new
FITTING_SHARE = 0.15  # ours: of those, the share that must fit; furniture may have been moved
ROUGH_M = 0.02  # ours: largest weighted residual of a good fit
GATE_PROBABILITY = 0.9995  # ours: share of correct registrations inside the gate
NEW_SHARE = 0.6  # ours: a keyframe is added where fewer points have correspondences
SWEEP = 40  # ours: scans that are searched for together; the head has looked to both sides, the body turned
REJECTED_SCANS = 25  # ours: in a row before recovery; 8 s in front of rearranged furniture
RECOVERY_SIGMA_M = 0.25  # ours: added to the position then
RECOVERY_SIGMA_RAD = math.radians(8.0)  # ours: and to the heading


@dataclass(frozen=True)
class RegistrationConfig:
    """When scans are registered, and how many keyframes are kept."""

    enabled: bool = setting(
        True, "", "registers scans; false leaves landmarks and dead reckoning", "ours"
    )
    beside_landmarks: bool = setting(
        False,
        "",
        "registers scans in scenes with landmarks too",
        "ours: with tags the pose is more consistent without (NEES 2.3, not 6)",
    )
    most_keyframes: int = 80  # ours: 10 m through a home take 30; number of keyframes kept

    def __post_init__(self) -> None:
        if self.most_keyframes < 1:
            raise ConfigError(
                f"registration: most_keyframes={self.most_keyframes} must be at least 1"
            )


@dataclass(frozen=True)
class RegistrationReport:
    """Result of one registration.

    Args:
        outcome: "used", "new" (no overlap: the scan became a keyframe), "adrift" (the pose is too uncertain for
            that, and was not found), "poor" (too few points or correspondences), "rough" (no pose fits) or "gate"
            (fits, but too far from the expected pose).
        correspondences: Number of points with a correspondence.
        nis: Normalised innovation squared, chi-square with `degrees` degrees of freedom if consistent.
        degrees: Number of observable directions of current pose and keyframes together.
        keyframes: Number of keyframes kept.
    """

    outcome: str
    correspondences: int = 0
    nis: float = 0.0
    degrees: int = 0
    keyframes: int = 0


class Registration:
    """The keyframes, and the correction of the robot's state by them."""

    def __init__(self, config: RegistrationConfig | None = None) -> None:
        self.config = config or RegistrationConfig()
        self.keyframes = KeyframePoses(WALKER_SIZE)
        self._scans: list[Scan] = []
        self._circles: list[tuple[float, float, float]] = []  # around each scan, in its own frame
        self._used: list[int] = []  # scan at which each was last used
        self._count = 0
        self._rejected = 0
        self._walks = False  # whether the robot made a step since the last scan
        self.factor = NoiseFactor(LEAST_NIS)
        """Of the standard deviations of a scan as a whole."""
        self._adrift: list[tuple[Pose2, Scan]] = []  # seen since the pose is too uncertain

    def predict(
        self,
        before: Gaussian,
        odometry: StepOdometry | None,
        noise: Float[np.ndarray, "10 10"],
        after: Gaussian,
    ) -> None:
        """Follow a prediction of the pose filter.

        Args:
            before, after: Its state.
            odometry: As given to the filter.
            noise: Covariance that it added.
        """
        self._walks = odometry is not None and odometry.steps != 0.0
        F, predicted = linearised_motion(before, odometry, noise)
        self.keyframes.predict(before, F, predicted, after)

    def correct(self, before: Gaussian, after: Gaussian) -> None:
        """Follow an update of the pose filter with landmarks."""
        self.keyframes.correct(before, after)

    def register(
        self,
        state: Gaussian,
        scan: Scan,
        heading_rad: float = 0.0,
        anchored: bool = False,
        shift: Float[np.ndarray, "3"] | None = None,
    ) -> tuple[Gaussian, RegistrationReport]:
        """Register a scan, and add it as a keyframe where the map is incomplete.

        Args:
            state: The robot's state, entries as in `filtering.models`.
            scan: Body frame.
            heading_rad: Bearing of the sensor in the body frame, to which the forward and lateral errors refer.
            anchored: True if landmarks agree with the state; then a contradicting map is wrong.
            shift: Standard deviation of the body's motion (x, y, yaw) by the clock offset, body frame; None for none.

        Returns:
            The corrected state (unchanged without a good registration), and the report.
        """
        self._count += 1
        if len(scan) < LEAST_POINTS:
            return state, self._report("poor")
        self.keyframes.clone(state, SENSOR_POSE, self._noise(state, heading_rad, shift))
        state, report, covered = self._compare(state, scan)
        fresh = report.outcome == "new" or (report.outcome == "used" and covered < NEW_SHARE)
        if report.outcome in ("rough", "gate"):
            state = self._recover(state, anchored)
        elif report.outcome == "used":
            self._rejected, self._adrift = 0, []
        if fresh and self._rejected == 0:
            self._scans.append(scan)
            centre, radius = _circle(scan)
            self._circles.append((float(centre[0]), float(centre[1]), radius))
            self._used.append(self._count)
            self._limit_keyframes()
        else:
            self.keyframes.drop(-1)
        return state, self._report(report.outcome, report)

    def _noise(
        self, state: Gaussian, heading_rad: float, shift: Float[np.ndarray, "3"] | None
    ) -> Float[np.ndarray, "3 3"]:
        """Covariance of the sensor pose: the error of a scan as a whole."""
        c, s = math.cos(state.mean[YAW] + heading_rad), math.sin(state.mean[YAW] + heading_rad)
        R = np.array([[c, -s], [s, c]])
        own = np.array([AHEAD_SIGMA_M, LATERAL_SIGMA_M]) ** 2
        noise = np.zeros((POSE_SIZE, POSE_SIZE))
        noise[:2, :2] = R @ np.diag(own) @ R.T
        noise[2, 2] = TURN_SIGMA_RAD**2
        noise *= self.factor.value**2
        if shift is not None:
            x, y = Pose2(yaw=float(state.mean[YAW])).rotation @ shift[:2]
            moved = np.array([x, y, shift[2]])
            noise += np.outer(moved, moved)
        return noise

    def _compare(self, state: Gaussian, scan: Scan) -> tuple[Gaussian, RegistrationReport, float]:
        """Update with the current scan, whose sensor pose is the last keyframe; also the share of known points."""
        if not self._scans:
            return state, RegistrationReport("new"), 0.0
        start = Pose2(*self.keyframes.pose(-1).tolist())
        apart = 3.0 * self._relative_sigma(state, range(len(self._scans)))
        near = self._within_reach(scan.at(start), apart)
        unknown = "new" if self._rejected == 0 else "gate"
        if GATE_M + apart > WIDEST_GATE_M:
            unknown = "adrift"
        if not near:
            return state, RegistrationReport(unknown), 0.0
        gate = GATE_M + 3.0 * self._relative_sigma(state, near)
        if gate > WIDEST_GATE_M:
            found = self._search(state, self._around(scan), near)
            if found is None:
                return state, RegistrationReport(unknown), 0.0
            start, gate = found, WIDEST_GATE_M
        chosen, known = self._overlapping(scan.at(start), near)
        if not chosen:
            return state, RegistrationReport(unknown), 0.0
        expected, trust = self.keyframes.pose(-1).copy(), self._given_keyframes(state, chosen)
        fit = align(scan, self._scans_of(chosen), start, gate, expected, trust)
        share = fit.correspondences / len(scan)
        if known >= KNOWN_SHARE and share < FITTING_SHARE * known:
            # a known place that does not fit
            return state, RegistrationReport("rough", fit.correspondences), share
        if fit.correspondences < LEAST_POINTS or share < LEAST_SHARE:
            outcome = "poor" if unknown == "gate" else unknown
            return state, RegistrationReport(outcome, fit.correspondences), share
        if fit.roughness > ROUGH_M**2:
            return state, RegistrationReport("rough", fit.correspondences), share
        indices = [len(self.keyframes) - 1, *chosen]
        S = self.keyframes.innovation_covariance(state, indices, fit.H)
        nis = float(fit.innovation @ np.linalg.solve(S, fit.innovation))
        degrees = len(fit.H)
        if self._walks:  # standing, it errs the same way again
            self.factor.learn(nis / POSE_SIZE)  # keyframes among themselves hardly differ
        if nis > chi_square_quantile(GATE_PROBABILITY, degrees):
            return state, RegistrationReport("gate", fit.correspondences, nis, degrees), share
        for j in chosen:
            self._used[j] = self._count
        state = self.keyframes.update(state, indices, fit.H, fit.innovation)
        return state, RegistrationReport("used", fit.correspondences, nis, degrees), share

    def _around(self, scan: Scan) -> Scan:
        """The scan with those before it since the pose is uncertain: what the head has seen from here."""
        now = Pose2(*self.keyframes.pose(-1).tolist())
        self._adrift = [*self._adrift, (now, scan)][-SWEEP:]
        return joined([one.at(now.inverse() @ pose) for pose, one in self._adrift])

    def _search(self, state: Gaussian, scan: Scan, near: list[int]) -> Pose2 | None:
        """The sensor pose among these keyframes, to within a cell; None if it is not the only one."""
        views = [(Pose2(*self.keyframes.pose(j).tolist()), self._scans[j]) for j in near]
        given = np.linalg.inv(self._given_keyframes(state, near))
        return scan_search.find(scan, views, Gaussian(self.keyframes.pose(-1), given))

    def _overlapping(self, level: Scan, near: list[int]) -> tuple[list[int], float]:
        """Those keyframes with most correspondences, best first, and the share of points with any."""
        found = self._scans_of(near).correspondences(level, WIDEST_GATE_M)
        counts = np.sum(found >= 0, axis=0)
        order = np.argsort(-counts, kind="stable")[:TOGETHER]
        chosen = [near[j] for j in order if 2 * counts[j] >= LEAST_POINTS]
        return chosen, float(np.mean(np.any(found >= 0, axis=1)))

    def _within_reach(self, level: Scan, apart: float) -> list[int]:
        """Keyframes that may overlap with the scan, which may be elsewhere by this distance, by bounding circles."""
        centre, radius = _circle(level)
        poses = self.keyframes.mean.reshape(-1, POSE_SIZE)[:-1]
        local = np.array(self._circles)
        c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
        x = poses[:, 0] + c * local[:, 0] - s * local[:, 1] - centre[0]
        y = poses[:, 1] + s * local[:, 0] + c * local[:, 1] - centre[1]
        reach = local[:, 2] + radius + GATE_M + apart
        return [int(j) for j in np.flatnonzero(x * x + y * y < reach * reach)]

    def _relative_sigma(self, state: Gaussian, near: Sequence[int]) -> float:
        """Standard deviation of the distance of corresponding points by the pose uncertainty, m.

        That of the keyframe with the highest correlation.
        """
        P = self.keyframes.covariance(state, [*near, len(self.keyframes) - 1])
        own = np.diag(P).reshape(-1, POSE_SIZE)
        last = P.shape[0] - POSE_SIZE
        across = np.stack([P[k::POSE_SIZE, last + k] for k in range(POSE_SIZE)], axis=1)
        relative = np.maximum(own[:-1] + own[-1] - 2.0 * across[:-1], 0.0)
        return float(np.sqrt(np.min(relative[:, 0] + relative[:, 1] + ARM_M**2 * relative[:, 2])))

    def _scans_of(self, chosen: list[int]) -> KeyframeScans:
        """The scans of some keyframes at their present poses."""
        poses = np.array([self.keyframes.pose(j) for j in chosen])
        return KeyframeScans.at(poses, [self._scans[j] for j in chosen])

    def _given_keyframes(self, state: Gaussian, chosen: list[int]) -> Float[np.ndarray, "3 3"]:
        """Information on the current pose if these keyframes were known exactly."""
        P = self.keyframes.covariance(state, [*chosen, len(self.keyframes) - 1])
        across = P[:-POSE_SIZE, -POSE_SIZE:]
        given = P[-POSE_SIZE:, -POSE_SIZE:] - across.T @ np.linalg.solve(
            P[:-POSE_SIZE, :-POSE_SIZE] + 1e-10 * np.eye(len(across)), across
        )
        return np.asarray(np.linalg.inv(models.positive(given) + 1e-10 * np.eye(POSE_SIZE)))

    def _recover(self, state: Gaussian, anchored: bool) -> Gaussian:
        """After many rejected scans in a row: drop the map if landmarks agree with the state, else inflate it."""
        self._rejected += 1
        if self._rejected < REJECTED_SCANS:
            return state
        self._rejected = 0
        if anchored:
            log.info("the map contradicts the landmarks: %d keyframes dropped", len(self._scans))
            while self._scans:
                self._drop(0)
            return state
        log.info("%d scans in a row rejected: covariance inflated", REJECTED_SCANS)
        self.keyframes.decorrelate(state)
        P = np.array(state.covariance)
        P[[X, Y], [X, Y]] += RECOVERY_SIGMA_M**2
        P[YAW, YAW] += RECOVERY_SIGMA_RAD**2
        return Gaussian(state.mean, P)

    def _limit_keyframes(self) -> None:
        """Beyond the limit, drop the keyframe that was not used for longest."""
        if len(self._scans) > self.config.most_keyframes:
            self._drop(int(np.argmin(self._used)))

    def _drop(self, index: int) -> None:
        del self._scans[index], self._circles[index], self._used[index]
        self.keyframes.drop(index)

    def _report(self, outcome: str, found: RegistrationReport | None = None) -> RegistrationReport:
        if found is None:
            return RegistrationReport(outcome, keyframes=len(self._scans))
        return RegistrationReport(
            outcome, found.correspondences, found.nis, found.degrees, len(self._scans)
        )


def _circle(scan: Scan) -> tuple[Float[np.ndarray, "2"], float]:
    """Centre and radius of the bounding circle."""
    centre = (scan.points.min(axis=0) + scan.points.max(axis=0)) / 2.0
    return centre, float(np.sqrt(np.max(np.sum((scan.points - centre) ** 2, axis=1))))
