"""Scan registration in rooms made of line segments."""

from __future__ import annotations

import math

import numpy as np
import pytest

from perception.filtering import models
from perception.localisation.filter import PoseFilter
from perception.localisation.localiser_noise import (
    LocaliserConfig,
    linearised_motion,
    process_noise,
)
from perception.localisation.registration import (
    REJECTED_SCANS,
    Registration,
    RegistrationConfig,
)
from perception.localisation.scan import Scan
from perception.primitives.errors import ConfigError
from perception.primitives.frame import Imu, StepOdometry
from perception.primitives.gaussian import Gaussian
from perception.primitives.pose import Pose2, wrap_angle

DEG = math.pi / 180
START = np.diag([0.001, 0.001, 0.05 * DEG]) ** 2
ROOM = [((0, 0), (4, 0)), ((4, 0), (4, 3)), ((4, 3), (0, 3)), ((0, 3), (0, 0)), ((2, 3), (2, 2.2))]
WALL = [((-3, 1), (9, 1))]
NOISE_M = 0.003
Walls = list[tuple[tuple[float, float], tuple[float, float]]]
HALF_VIEW = 0.7
REACH_M = 4.5


def seen(
    walls: Walls,
    apparent: Pose2,
    pan: float,
    rng: np.random.Generator,
) -> Scan:
    """Scan of the walls within range and field of view of a sensor turned by pan, by exact ray casting."""
    bearings = pan + np.linspace(-HALF_VIEW, HALF_VIEW, 80)
    rays = np.column_stack([np.cos(bearings), np.sin(bearings)])
    to_walls = apparent.inverse()
    best, faces = np.full(len(rays), REACH_M), np.zeros((len(rays), 2))
    for a, b in walls:
        p, q = to_walls.apply(np.array([a, b], dtype=float))
        along = q - p
        normal = np.array([along[1], -along[0]]) / np.linalg.norm(along)
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = (normal @ p) / (rays @ normal)
            share = ((rays * reach[:, None] - p) @ along) / (along @ along)
        met = (reach > 0.1) & (reach < best) & (share >= 0) & (share <= 1)
        best[met] = reach[met]
        faces[met] = normal if normal @ p < 0 else -normal
    hit = best < REACH_M
    noise = NOISE_M * rng.standard_normal(hit.sum())
    places = rays[hit] * best[hit, None] + faces[hit] * noise[:, None]
    return Scan(places, faces[hit], np.full(hit.sum(), NOISE_M))


class Body:
    """Walks in circles: ground truth, odometry, gyro and the pose of a swaying sensor."""

    def __init__(self, seed: int, start: Pose2, turn_rad: float) -> None:
        self.rng = np.random.default_rng(seed)
        self.true = start
        self.turn_rad = turn_rad
        self.drift = self.rng.uniform(-0.2, 0.2) * DEG
        self.bias = 0.005 * self.rng.standard_normal()
        self.pan_offset = 0.3 * DEG * self.rng.standard_normal()

    def step(self, still: bool) -> tuple[StepOdometry, Imu]:
        """Half a footstep; standing at first."""
        if still:
            made, slip, steps = Pose2(), Pose2(), 0.0
        else:
            made, steps = Pose2(0.022, 0.0, self.turn_rad), 0.5
            forward, left, turn = self.rng.standard_normal(3) * [0.0015, 0.0006, 0.6 * DEG]
            root = math.sqrt(0.5)
            slip = Pose2(-0.0006 + root * forward, root * left, 0.5 * self.drift + root * turn)
        before = self.true
        self.true = self.true @ made @ slip
        rate = wrap_angle(self.true.yaw - before.yaw) / 0.325 + self.bias
        rate += 0.002 * self.rng.standard_normal()
        return StepOdometry(made, steps), Imu(
            np.array([0.0, 0.0, rate]), np.array([0.0, 0.0, 9.81])
        )

    def apparent(self) -> Pose2:
        """The pose that its scan seems to be taken from."""
        ahead, lateral, turn = self.rng.standard_normal(3) * [0.0033, 0.0048, 0.4 * DEG]
        return self.true @ Pose2(float(ahead), float(lateral), float(turn) + self.pan_offset)


def predict(
    filter: PoseFilter, map: Registration, odometry: StepOdometry | None, imu: Imu | None, dt: float
) -> None:
    """Advance filter and map."""
    before = filter.state
    filter.predict(odometry, imu, dt)
    map.predict(before, odometry, filter.process_noise, filter.state)


def walk(
    seed: int, frames: int = 160, on: bool = True, config: RegistrationConfig | None = None
) -> tuple[np.ndarray, np.ndarray, Registration]:
    """Errors (n, 3), covariances, and the map, of a walk in the room."""
    localiser = LocaliserConfig()
    body = Body(seed, Pose2(1.0, 0.9, 0.1), 2.4 * DEG)
    filter = PoseFilter(Gaussian(body.true.vector, START), [], localiser)
    map = Registration(config)
    errors, covariances = [], []
    for k in range(frames):
        odometry, imu = body.step(still=k < 8)
        predict(filter, map, odometry, imu, 0.325)
        if on:
            pan = (0.0, 0.7, 0.0, -0.7)[k % 4]
            state, _ = map.register(filter.state, seen(ROOM, body.apparent(), pan, body.rng), pan)
            filter.set_state(state)
        error = filter.pose.mean - body.true.vector
        error[2] = wrap_angle(float(error[2]))
        errors.append(error)
        covariances.append(filter.pose.covariance)
    return np.array(errors), np.array(covariances), map


def test_registration_bounds_the_drift_without_landmarks() -> None:
    errors = np.concatenate([walk(seed)[0][80:] for seed in range(3)])
    lost = np.concatenate([walk(seed, on=False)[0][80:] for seed in range(3)])
    position, heading = (
        np.sqrt(np.mean(errors[:, :2] ** 2) * 2),
        np.sqrt(np.mean(errors[:, 2] ** 2)),
    )
    assert position < 0.02
    assert heading < 0.4 * DEG
    assert position < 0.5 * np.sqrt(np.mean(lost[:, :2] ** 2) * 2)


def test_the_pose_is_consistent_with_its_covariance() -> None:
    """A map of one's own poses may count information twice; the mean NEES over eight walks must not show it."""
    means = []
    for seed in range(8):
        errors, covariances, _ = walk(seed, 100)
        means.append(
            np.mean([e @ np.linalg.solve(P, e) for e, P in zip(errors, covariances, strict=True)])
        )
    assert 0.9 < float(np.mean(means)) < 4.9  # 3 if consistent; 95 % of eight samples: 1.6 to 4.9


def test_a_single_wall_leaves_the_position_along_it_unobservable() -> None:
    rng = np.random.default_rng(0)
    filter = PoseFilter(Gaussian(np.array([0.0, 0.0, math.pi / 2]), START), [])
    map = Registration()
    map.register(filter.state, seen(WALL, Pose2(0.0, 0.0, math.pi / 2), 0.0, rng))
    state = filter.state
    wide = state.covariance.copy()
    wide[:3, :3] += np.diag([0.05, 0.05, 3 * DEG]) ** 2
    map.keyframes.decorrelate(state)
    after, report = map.register(
        Gaussian(state.mean, wide), seen(WALL, Pose2(0.0, 0.0, math.pi / 2), 0.0, rng)
    )
    assert report.outcome == "used"
    along, across, turn = np.sqrt(np.diag(after.covariance)[:3])
    assert along == pytest.approx(0.05, rel=0.02)
    assert across < 0.012
    assert turn < 1.0 * DEG


def test_a_new_object_in_half_of_the_scan_does_not_bias_the_pose() -> None:
    rng = np.random.default_rng(1)
    here = Pose2(1.0, 0.9, 0.1)
    filter = PoseFilter(Gaussian(here.vector, START), [])
    map = Registration()
    for pan in (0.0, 0.7, -0.7):
        map.register(filter.state, seen(ROOM, here, pan, rng), pan)
    chair = [((1.9, 0.4), (1.9, 0.9)), ((1.9, 0.9), (2.3, 0.9))]
    after, report = map.register(filter.state, seen(ROOM + chair, here, 0.0, rng))
    assert report.outcome == "used"
    assert np.linalg.norm(after.mean[:2] - here.vector[:2]) < 0.006


def test_a_scan_of_another_place_is_rejected() -> None:
    """Displaced by a foot with a certain pose: gated, nothing updated, no keyframe added."""
    rng = np.random.default_rng(2)
    here = Pose2(1.0, 0.9, 0.1)
    filter = PoseFilter(Gaussian(here.vector, START), [])
    map = Registration()
    map.register(filter.state, seen(ROOM, here, 0.0, rng))
    after, report = map.register(filter.state, seen(ROOM, here @ Pose2(-0.3, 0.25, 0.0), 0.0, rng))
    assert report.outcome in ("gate", "rough")
    assert report.keyframes == 1
    assert np.array_equal(after.mean, filter.state.mean)


def test_after_a_small_displacement_it_recovers_the_pose() -> None:
    rng = np.random.default_rng(3)
    here = Pose2(1.0, 0.9, 0.1)
    filter = PoseFilter(Gaussian(here.vector, START), [])
    map = Registration()
    for pan in (0.0, 0.7, -0.7):
        map.register(filter.state, seen(ROOM, here, pan, rng), pan)
    there = here @ Pose2(0.12, 0.08, 4 * DEG)
    for k in range(50):
        predict(filter, map, StepOdometry(Pose2(), 0.0), None, 0.3)
        pan = (0.0, 0.7, -0.7)[k % 3]
        state, _ = map.register(filter.state, seen(ROOM, there, pan, rng), pan)
        filter.set_state(state)
    error = filter.pose.mean - there.vector
    assert np.linalg.norm(error[:2]) < 0.02
    assert abs(error[2]) < 1.0 * DEG


def after_a_gap(
    seed: int, seconds: float, walls: Walls
) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Error, covariance and outcomes of a robot that walked and turned on while nothing was measured, then stands.

    Before it has looked round; afterwards the head turns to both sides.
    """
    body = Body(seed, Pose2(1.0, 0.9, 0.1), 2.4 * DEG)
    filter, map = PoseFilter(Gaussian(body.true.vector, START), []), Registration()
    pans = (0.0, 0.7, 1.4, 0.7, 0.0, -0.7, -1.4, -0.7)
    for k in range(24):
        predict(filter, map, *body.step(still=k < 8), 0.325)
        pan = pans[k % 8]
        filter.set_state(
            map.register(filter.state, seen(walls, body.apparent(), pan, body.rng), pan)[0]
        )
    turn = 0.37 * seconds * float(body.rng.uniform(-1.0, 1.0))
    body.true = body.true @ Pose2(0.05 * seconds, 0.0, turn)
    predict(filter, map, None, None, seconds)
    outcomes = []
    for k in range(8):
        predict(filter, map, StepOdometry(Pose2(), 0.0), None, 0.325)
        state, report = map.register(
            filter.state, seen(walls, body.apparent(), pans[k], body.rng), pans[k]
        )
        filter.set_state(state)
        outcomes.append(report.outcome)
    error = filter.pose.mean - body.true.vector
    error[2] = wrap_angle(float(error[2]))
    return error, filter.pose.covariance, outcomes


@pytest.mark.parametrize(("seconds", "least"), [(1.0, 12), (2.5, 8)])
def test_after_a_gap_in_all_measurements_the_map_gives_the_pose_back(
    seconds: float, least: int
) -> None:
    """Who is not found after looking to both sides knows that."""
    found, gone = [], []
    for error, covariance, outcomes in (after_a_gap(seed, seconds, ROOM) for seed in range(12)):
        squared = float(error @ np.linalg.solve(covariance, error))
        (gone if outcomes[-1] == "adrift" else found).append(squared)
        if outcomes[-1] != "adrift":
            assert math.hypot(*error[:2]) < 0.05
            assert abs(error[2]) < 2.0 * DEG
    assert len(found) >= least
    assert np.mean(found) < 4.9  # 3 if consistent; 99 % of twelve samples below
    assert not gone or np.mean(gone) < 6.0


def test_a_map_that_contradicts_the_landmarks_is_dropped() -> None:
    rng = np.random.default_rng(4)
    here = Pose2(1.0, 0.9, 0.1)
    filter = PoseFilter(Gaussian(here.vector, START), [])
    map = Registration()
    map.register(filter.state, seen(ROOM, here @ Pose2(0.05, 0.04, 3 * DEG), 0.0, rng))
    for _ in range(REJECTED_SCANS + 1):
        state, report = map.register(filter.state, seen(ROOM, here, 0.0, rng), anchored=True)
        assert np.allclose(state.covariance, filter.state.covariance, rtol=0.5)
    assert report.outcome in ("new", "used")  # a new map


def test_estimates_are_reproducible_bit_for_bit() -> None:
    assert np.array_equal(walk(5, 40)[0], walk(5, 40)[0])


def test_the_number_of_keyframes_is_bounded() -> None:
    _, _, map = walk(6, 120, config=RegistrationConfig(most_keyframes=3))
    assert len(map.keyframes) == 3


def test_linearised_motion_agrees_with_the_motion_model() -> None:
    """The Jacobian against finite differences of the motion model."""
    rng = np.random.default_rng(7)
    x = rng.standard_normal(models.WALKER_SIZE) * 0.01
    x[models.YAW] = 0.7
    odometry = StepOdometry(Pose2(0.03, 0.01, 0.1), 0.6)
    P = np.eye(models.WALKER_SIZE) * 1e-4
    Q = process_noise(LocaliserConfig(), 0.7, 0.6, 0.3, blind_s=None)
    F, predicted = linearised_motion(Gaussian(x, P), odometry, Q)
    for k in range(models.WALKER_SIZE):
        up, down = x.copy(), x.copy()
        up[k] += 1e-5
        down[k] -= 1e-5
        column = (
            models.walk(up, 0.3, odometry.motion, 0.6)
            - models.walk(down, 0.3, odometry.motion, 0.6)
        ) / 2e-5
        assert np.allclose(F[:, k], column, atol=1e-8)
    assert np.allclose(predicted.covariance, F @ P @ F.T + Q, atol=1e-12)


def test_a_map_without_keyframes_is_refused() -> None:
    with pytest.raises(ConfigError, match="most_keyframes=0"):
        RegistrationConfig(most_keyframes=0)
