"""Unscented Kalman filter of the walking robot's pose, from step odometry, gyro and landmarks.

The state holds, beside the pose, the errors that are constant within a run (see `filtering.models`), so that
landmarks estimate them. The gyro measures the turn since the previous frame. The landmarks of one frame are
used in one update, because they share the pan error of the head. How large the noise of steps and of sightings is,
is learnt from the innovations (`noise_factor`). The sigma points are those of `ukf_engines`
and the noise that of `localiser_noise`; this module has the gating, the data association and the recovery.

Measurements that contradict each other for seconds are a fault, of which nobody can tell which one errs. Gyro and steps
are compared by `turn_check`. While landmarks disagree with the pose, pose and sightings are both less certain, by what
they disagree.

Source: seed 001, section 3, eq. (2) (sigma-point filter).
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from ..filtering import models
from ..filtering.consistency import Innovation, chi_square_quantile
from ..filtering.models import PAN, WALKER_SIZE, YAW, X, Y
from ..monitoring.agreement import Surprise
from ..monitoring.status import LOST, SLOW, STAND, Doubt
from ..primitives.errors import ConfigError
from ..primitives.frame import Imu, StepOdometry
from ..primitives.gaussian import Gaussian
from ..primitives.landmark import Landmark, Sighting
from ..primitives.pose import Pose2
from .localiser_noise import LocaliserConfig, joint_noise, process_noise, range_sigmas
from .noise_factor import NoiseFactor
from .relocalisation import RecentSightings, pose_from_sightings
from .turn_check import LASTING, TurnCheck
from .ukf_engines import ukf_engine

log = logging.getLogger(__name__)

GATE_PROBABILITY = 0.999  # ours: share of correct sightings inside the gate
RECOVERY_SIGMA_M = 0.15  # ours: added to the position when most sightings are rejected
RECOVERY_SIGMA_RAD = math.radians(8.0)  # ours: added to the heading then
SIGHTINGS_LEAST_NIS = 0.5  # ours: half of what a sighting errs by lasts through many frames
TESTED = 4  # ours: frames with sightings that are tested together; two seconds
DOUBTED = (X, Y, YAW, PAN)
DOUBT_BEGINS = np.array([0.06, 0.06, math.radians(2.0), math.radians(5.0)])
"""Ours: deviation added to position, heading and pan offset when landmarks begin to disagree, m and rad."""
DOUBT_GOES_ON = np.array([0.04, 0.04, math.radians(1.0), math.radians(2.0)])
"""Ours: likewise while they disagree, per square root of a second."""
LOST_SIGMA_M, FOUND_SIGMA_M = 0.30, 0.15  # ours: of the position of a lost robot, and found again
LOST_SIGMA_RAD, FOUND_SIGMA_RAD = math.radians(20.0), math.radians(10.0)  # ours: of its heading
LOST_FRAMES = 3  # ours: mostly rejected frames in a row of a robot that is lost


@dataclass(frozen=True)
class UpdateReport:
    """Result of the update with the sightings of one frame.

    Args:
        accepted: Number of sightings used.
        rejected: Number of those not used: unknown, ambiguous, not finite, or outside the gate.
        innovations: Of every sighting of a landmark with a known identity, used or not.
        doubts: What contradicts what, for the status.
    """

    accepted: int
    rejected: int
    innovations: list[Innovation]
    doubts: tuple[Doubt, ...] = ()

    @property
    def nis(self) -> list[float]:
        """Normalised innovation squared of each, chi-square with two degrees of freedom if consistent."""
        return [innovation.nis for innovation in self.innovations]


class PoseFilter:
    """The robot's pose on the floor with its covariance."""

    def __init__(
        self, start: Gaussian, landmarks: Sequence[Landmark], config: LocaliserConfig | None = None
    ) -> None:
        """Begin at a pose.

        Args:
            start: Over (x, y, yaw), m and rad, world frame.
            landmarks: The map of landmarks.
            config: Noise; the defaults if None.
        """
        if start.mean.shape != (3,) or not np.all(np.isfinite(start.mean)):
            raise ConfigError(f"localiser: start {start.mean} must be a finite (x, y, yaw)")
        self.config = config or LocaliserConfig()
        self._positions = {mark.identity: np.array(mark.position[:2]) for mark in landmarks}
        self._gate = chi_square_quantile(GATE_PROBABILITY, 2)
        self._frames_rejected = 0
        self._recent = RecentSightings()  # of the frames rejected in a row
        self._walks = False  # whether it made a step since the last frame
        self._sightings_factor = NoiseFactor(SIGHTINGS_LEAST_NIS)
        self._blind_s: float | None = None  # time without odometry; None while there is some
        state = self.config.initial_state(start)
        self._turns, self._surprise = TurnCheck(state), Surprise(2, TESTED)
        self._lost = False
        self.process_noise: Float[np.ndarray, "10 10"] = np.zeros((WALKER_SIZE, WALKER_SIZE))
        """Covariance that the last prediction added to the state."""
        self._ukf = ukf_engine(self.config.engine, state)

    @property
    def pose(self) -> Gaussian:
        """Gaussian over (x, y, yaw), m and rad, world frame; the yaw in [-pi, pi)."""
        state = self._ukf.state
        return Gaussian(state.mean[:3], state.covariance[:3, :3].copy())

    @property
    def noise(self) -> LocaliserConfig:
        """The noise as far as it is learnt."""
        return self.config.times(self._turns.factor.value, self._sightings_factor.value)

    @property
    def pose2(self) -> Pose2:
        """The mean pose."""
        x, y, yaw = (float(v) for v in self._ukf.state.mean[:3])
        return Pose2(x, y, yaw)

    @property
    def state(self) -> Gaussian:
        """The whole state, entries as in `filtering.models`."""
        return self._ukf.state

    def set_state(self, state: Gaussian) -> None:
        """Replace the whole state, for example after `registration`."""
        self._ukf.reset(state)

    def doubts(self) -> list[Doubt]:
        """What contradicts what, and whether the robot knows where it is."""
        P = self._ukf.state.covariance
        metres = math.sqrt(float(np.linalg.eigvalsh(P[:2, :2])[-1]))
        radians = math.sqrt(float(P[YAW, YAW]))
        widest = (FOUND_SIGMA_M, FOUND_SIGMA_RAD) if self._lost else (LOST_SIGMA_M, LOST_SIGMA_RAD)
        rejected = self._frames_rejected >= (1 if self._lost else LOST_FRAMES)
        self._lost = metres > widest[0] or radians > widest[1] or rejected
        found = [
            (self._lost, Doubt(LOST, STAND)),
            (self._blind_s is not None, Doubt("no odometry", STAND)),
            (not self._turns.agree, Doubt("gyro and steps disagree", SLOW)),
            (not self._surprise.agrees, Doubt("landmarks disagree", SLOW)),
        ]
        return [doubt for holds, doubt in found if holds]

    def predict(self, odometry: StepOdometry | None, imu: Imu | None, dt: float) -> None:
        """Advance to the next frame.

        Args:
            odometry: Motion since the previous frame; None or not finite: the robot may have walked.
            imu: Means over that time; None or not finite: no gyro.
            dt: That time, s, not negative.
        """
        if odometry is not None and not _finite(odometry.motion.vector, odometry.steps):
            log.warning("step odometry %s is not finite and is not used", odometry)
            odometry = None
        dt = max(dt, 0.0) if math.isfinite(dt) else 0.0
        motion = odometry.motion if odometry else Pose2()
        steps = abs(odometry.steps) if odometry else 0.0
        self._walks = steps > 0.0
        yaw = float(self._ukf.state.mean[YAW])
        config = self.noise
        blind_s = self._blind_s or 0.0
        noise = process_noise(config, yaw, steps, dt, blind_s if odometry is None else None)
        if not self._surprise.agrees:
            noise[DOUBTED, DOUBTED] += dt * DOUBT_GOES_ON**2
        turn_rad, sigma_rad = None, config.gyro_sigma_radps * dt
        if imu is not None and dt > 0.0 and _finite(imu.angular_velocity, 0.0):
            turn_rad = float(imu.angular_velocity[2]) * dt
            before = self._turns.compare(
                self._ukf.state, turn_rad, sigma_rad, motion, steps, dt, noise
            )
            if before is not None:
                self._restore(before)
        self._blind_s = blind_s + dt if odometry is None else None
        self._ukf.predict(motion, steps, noise)
        self.process_noise = noise
        if odometry is None:
            self._recent.clear()
        elif self._frames_rejected > 0:
            turn = Pose2(yaw=yaw).lifted().rotation
            self._recent.move(motion, turn.T @ noise[:3, :3] @ turn)
        if turn_rad is not None:
            self._ukf.update_turn(turn_rad, sigma_rad, dt)

    def _restore(self, before: Gaussian) -> None:
        """The first entries of `LASTING` as before a fault, independent of all else."""
        state, entries = self._ukf.state, LASTING[: before.mean.size]
        mean, P = state.mean, state.covariance
        mean[entries] = before.mean
        P[entries, :] = P[:, entries] = 0.0
        P[np.ix_(entries, entries)] = before.covariance
        self._ukf.reset(Gaussian(mean, P))

    def update(self, sightings: Sequence[Sighting]) -> UpdateReport:
        """Update with the landmarks of one frame, all at once.

        A sighting without identity is associated with the only landmark inside the gate, if there is just one. When
        most sightings of several frames in a row are rejected, the filter resets its pose to the one that two
        sightings agree on and that explains those before, or else inflates its covariance until sightings are
        accepted again.
        """
        given, sightings = sightings, self._doubted(sightings)
        accepted: list[tuple[Sighting, np.ndarray]] = []
        innovations: list[Innovation] = []
        for sighting in sightings:
            position, innovation = self._associate(sighting)
            if innovation is not None:
                innovations.append(innovation)
            if position is not None:
                accepted.append((sighting, position))
        if accepted:
            self._update(accepted)
            for one in innovations if self._walks else ():  # standing, it errs the same way again
                if one.nis <= self._gate and self._surprise.agrees:
                    self._sightings_factor.learn(one.nis / 2.0)
        if 2 * len(accepted) > len(innovations):
            self._frames_rejected = 0
            self._recent.clear()
        elif innovations:
            self._recover(self._known(given))
        return UpdateReport(len(accepted), len(sightings) - len(accepted), innovations)

    def _doubted(self, sightings: Sequence[Sighting]) -> list[Sighting]:
        """The sightings with covariances as large as they disagree; when that begins, the state is doubted too."""
        agreed = self._surprise.agrees
        known = self._known(sightings)
        inside = [one for one in known if self._associate(one)[0] is not None]
        tested = inside if 2 * len(inside) > len(known) else known
        if tested:
            joint = Innovation.of(None, *self._residual(tested, self._positions_of(tested)))
            self._surprise.update(joint.nis, len(tested))
        factor = self._surprise.factor
        if agreed and not self._surprise.agrees:
            state = self._ukf.state
            state.covariance[DOUBTED, DOUBTED] += DOUBT_BEGINS**2
            self._ukf.reset(state)
        if factor == 1.0:
            return list(sightings)
        return [replace(one, covariance=factor * one.covariance) for one in sightings]

    def _associate(self, sighting: Sighting) -> tuple[np.ndarray | None, Innovation | None]:
        """Position of the landmark, None if the sighting is rejected; and its innovation, None without identity."""
        if not _is_finite(sighting):
            return None, None
        if sighting.identity is not None:
            position = self._positions.get(sighting.identity)
            if position is None:
                return None, None
            innovation = self._innovation(sighting, position)
            return (position if innovation.nis <= self._gate else None), innovation
        near = [
            (position, innovation)
            for position in self._positions.values()
            if (innovation := self._innovation(sighting, position)).nis <= self._gate
        ]
        return near[0] if len(near) == 1 else (None, None)

    def _known(self, sightings: Sequence[Sighting]) -> list[Sighting]:
        """The sightings of landmarks of the map."""
        return [one for one in sightings if one.identity in self._positions and _is_finite(one)]

    def _positions_of(self, known: Sequence[Sighting]) -> Float[np.ndarray, "k 2"]:
        """Where the landmarks of these sightings are."""
        return np.array(
            [self._positions[one.identity] for one in known if one.identity is not None]
        )

    def _innovation(self, sighting: Sighting, position: np.ndarray) -> Innovation:
        """Innovation of one sighting of the landmark at this position."""
        return Innovation.of(sighting.identity, *self._residual([sighting], position[None]))

    def _residual(
        self, sightings: Sequence[Sighting], places: Float[np.ndarray, "k 2"]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Measured minus expected (range, bearing, ...) of sightings of one frame, and its covariance."""
        measured, noise, sigmas = self._measurement(sightings)
        expected = self._ukf.expected(places, sigmas)
        covariance = models.positive(expected.covariance + noise)
        return models.sighting_difference(measured, expected.mean), covariance

    def _measurement(
        self, sightings: Sequence[Sighting]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(range, bearing, ...) of sightings of one frame, their joint covariance, and sigmas of the ranges."""
        measured = np.concatenate([sighting.measured for sighting in sightings])
        noise = joint_noise(
            [self._sightings_factor.value**2 * sighting.covariance for sighting in sightings],
            self.noise.shared_bearing_sigma_rad,
        )
        return measured, noise, range_sigmas(sightings)

    def _update(self, accepted: list[tuple[Sighting, np.ndarray]]) -> None:
        measured, noise, sigmas = self._measurement([sighting for sighting, _ in accepted])
        places = np.array([position for _, position in accepted])
        self._ukf.update(measured, noise, places, sigmas)

    def _recover(self, known: list[Sighting]) -> None:
        """After several rejected frames in a row: reset the pose, or inflate its covariance."""
        self._frames_rejected += 1
        positions = self._positions_of(known)
        if self._frames_rejected >= self.config.rejected_frames:
            found = self._found(known, positions)
            state = self._ukf.state
            mean, P = state.mean, state.covariance
            if found is not None:
                log.info("pose reset from %d landmarks of one frame", len(known))
                self._frames_rejected = 0
                self._recent.clear()
                mean[:3] = found.mean
                P[:3, :] = P[:, :3] = 0.0
                P[:3, :3] = found.covariance
            else:
                log.info("%d frames mostly rejected: covariance inflated", self._frames_rejected)
                P[[X, Y], [X, Y]] += RECOVERY_SIGMA_M**2
                P[YAW, YAW] += RECOVERY_SIGMA_RAD**2
            self.set_state(Gaussian(mean, P))
        if self._frames_rejected > 0:
            self._recent.add(known, positions)

    def _found(self, known: list[Sighting], positions: np.ndarray) -> Gaussian | None:
        """The pose by the landmarks of this frame, if it explains most sightings of those rejected before."""
        if len(known) < 2:
            return None
        _, noise, _ = self._measurement(known)
        found = pose_from_sightings(known, positions, noise)
        if found is None or not self._recent.confirm(found):
            return None
        return Gaussian(found.mean, self._surprise.factor * found.covariance)


def _finite(array: np.ndarray, number: float) -> bool:
    return bool(np.all(np.isfinite(array))) and math.isfinite(number)


def _is_finite(sighting: Sighting) -> bool:
    return _finite(sighting.measured, float(np.sum(sighting.covariance)))
