"""The gaze map against single directions, and the selection against its definition."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from perception.primitives.camera import Camera
from perception.primitives.errors import ConfigError
from perception.primitives.gaussian import Gaussian
from perception.primitives.pose import Pose2, Pose3, head_rotation
from perception.primitives.robot_model import GaitLimits, HeadLimits, RobotModel
from planning.commands import GazeCommand
from planning.gaze.attention import GazeContext
from planning.gaze.policy import MapGaze
from planning.gaze.selection import GazeMapConfig, gaze_map, highest_plateau, select, shown, worth

CONFIG = GazeMapConfig(step_deg=6.0)
EYE = -0.4  # of the floor from the camera, m
seeds = st.integers(0, 2**32 - 1)


def ground(rng: np.random.Generator, n: int) -> np.ndarray:
    away, bearing = rng.uniform(0.2, 2.0, n), rng.uniform(-math.pi, math.pi, n)
    return np.stack([away * np.cos(bearing), away * np.sin(bearing), np.full(n, EYE)], axis=-1)


@given(seeds)
@settings(max_examples=15, deadline=None)
def test_every_direction_shows_the_view_of_a_camera(seed):
    rng = np.random.default_rng(seed)
    places, weights = ground(rng, 40), rng.uniform(0, 1, 40)
    camera = Camera.from_view(
        1000, 1000, math.radians(CONFIG.across_deg), math.radians(CONFIG.down_deg)
    )
    expected = np.zeros((len(CONFIG.pans), len(CONFIG.tilts)))
    for i, pan in enumerate(CONFIG.pans):
        for j, tilt in enumerate(CONFIG.tilts):
            turned = Pose3.from_rotation(head_rotation(float(pan), float(tilt)), np.zeros(3))
            pixels = camera.project(turned.inverse().apply(places))
            expected[i, j] = weights[camera.contains(pixels)].sum()
    found = shown(places, weights, CONFIG)
    assert np.mean(np.isclose(found, expected, atol=1e-9)) > 0.995  # half a pixel at the border


def test_the_printed_rectangle_shows_too_much_when_looking_down():
    literal = GazeMapConfig(step_deg=6.0, literal=True)
    places = ground(np.random.default_rng(3), 300)
    a, b = shown(places, np.ones(300), CONFIG), shown(places, np.ones(300), literal)
    assert np.corrcoef(a.ravel(), b.ravel())[0, 1] > 0.8
    assert not np.allclose(a, b)


def test_with_stale_ground_on_both_sides_the_gaze_goes_to_one():
    sides = np.array([[0.4, 0.7, EYE], [0.45, 0.75, EYE], [0.4, -0.7, EYE]])
    nothing = np.zeros((0, 3))
    far = np.array([30.0, 0.0, EYE])
    by_count = gaze_map(1.0, sides, 0.0, far, 0.0, np.zeros(0), nothing, CONFIG)
    chosen = highest_plateau(by_count, GazeCommand(), CONFIG)
    assert chosen.pan_rad > math.radians(30)  # the side with more of it
    printed = GazeMapConfig(step_deg=6.0, literal=True)
    by_mean = gaze_map(1.0, sides[[0, 2]], 0.0, far, 0.0, np.zeros(0), nothing, printed)
    assert abs(highest_plateau(by_mean, GazeCommand(), printed).pan_rad) < math.radians(1)


def test_the_map_is_the_weighted_sum_of_its_parts():
    rng = np.random.default_rng(5)
    stale, obstacles, way = ground(rng, 60), ground(rng, 3), ground(rng, 1)[0]
    psi = rng.uniform(0, 1, 3)
    whole = gaze_map(0.7, stale, 0.4, way, 0.3, psi, obstacles, CONFIG)
    seen = shown(stale, np.ones(60), CONFIG)
    expected = 0.25 * 0.7 * seen / seen.max() + 0.25 * shown(way[None], np.array([0.4]), CONFIG)
    for place, one in zip(obstacles, psi, strict=True):
        expected += 0.25 * (one + 0.3) / 3 * shown(place[None], np.ones(1), CONFIG)
    np.testing.assert_allclose(whole, expected, atol=1e-12)


@given(seeds)
@settings(max_examples=40, deadline=None)
def test_the_selection_is_the_middle_of_the_best_connected_region(seed):
    rng = np.random.default_rng(seed)
    total = rng.integers(0, 3, (len(CONFIG.pans), len(CONFIG.tilts))).astype(float)
    present = GazeCommand(float(rng.uniform(-1.5, 1.5)), float(rng.uniform(0, 1)))
    left = {(int(i), int(j)) for i, j in np.argwhere(total == total.max())}
    middles = []
    while left:
        region, edge = set(), [left.pop()]
        while edge:
            i, j = edge.pop()
            region.add((i, j))
            near = {(i + a, j + b) for a in (-1, 0, 1) for b in (-1, 0, 1)} & left
            left -= near
            edge += near
        i, j = np.mean(sorted(region), axis=0)
        middles.append(
            (
                float(CONFIG.pans[0] + i * math.radians(6.0)),
                float(CONFIG.tilts[0] + j * math.radians(6.0)),
            )
        )
    chosen = highest_plateau(total, present, CONFIG)
    nearest = min(math.hypot(p - present.pan_rad, t - present.tilt_rad) for p, t in middles)
    assert any(
        math.isclose(p, chosen.pan_rad, abs_tol=1e-9)
        and math.isclose(t, chosen.tilt_rad, abs_tol=1e-9)
        and math.hypot(p - present.pan_rad, t - present.tilt_rad) <= nearest + 1e-9
        for p, t in middles
    )


def test_the_present_gaze_is_kept_until_another_is_clearly_better():
    total = np.zeros((len(CONFIG.pans), len(CONFIG.tilts)))
    total[3, 3], total[20, 5] = 1.0, 1.05
    aimed = GazeCommand(float(CONFIG.pans[3]), float(CONFIG.tilts[3]))
    assert worth(total, aimed, CONFIG) == 1.0
    assert select(total, GazeCommand(), aimed, CONFIG) == aimed
    total[20, 5] = 1.2
    other = select(total, GazeCommand(), aimed, CONFIG)
    assert other.pan_rad == pytest.approx(float(CONFIG.pans[20]))


def test_every_gaze_is_within_the_range_of_the_neck():
    rng = np.random.default_rng(2)
    for _ in range(20):
        total = gaze_map(
            1.0, ground(rng, 30), 1.0, ground(rng, 1)[0], 1.0, np.ones(4), ground(rng, 4), CONFIG
        )
        gaze = highest_plateau(total, GazeCommand(), CONFIG)
        assert abs(gaze.pan_rad) <= math.radians(CONFIG.head.pan_deg) + 1e-9
        assert 0.0 <= gaze.tilt_rad <= math.radians(CONFIG.head.tilt_deg[1]) + 1e-9


def test_impossible_directions_are_refused():
    with pytest.raises(ConfigError, match="tilt_deg"):
        HeadLimits(tilt_deg=(50.0, 20.0))
    with pytest.raises(ConfigError, match="step_deg"):
        GazeMapConfig(step_deg=0.0)


@pytest.mark.parametrize("head", [HeadLimits(50.0, (-5.0, 21.0)), HeadLimits(31.0, (0.0, 44.5))])
def test_the_directions_are_those_of_the_neck(head):
    config = GazeMapConfig(head=head, step_deg=3.0)
    pans, tilts = np.degrees(config.pans), np.degrees(config.tilts)
    for found, ends in ((pans, (-head.pan_deg, head.pan_deg)), (tilts, head.tilt_deg)):
        np.testing.assert_allclose(found[[0, -1]], ends, atol=1e-9)
        np.testing.assert_allclose(np.diff(found), np.diff(found)[0])
        assert np.diff(found)[0] <= 3.0
    assert np.abs(pans).min() < 1e-9
    total = np.zeros((len(pans), len(tilts)))
    total[-1, -1] = 1.0
    gaze = highest_plateau(total, GazeCommand(), config)
    assert math.degrees(gaze.pan_rad) == pytest.approx(head.pan_deg)
    assert math.degrees(gaze.tilt_rad) == pytest.approx(head.tilt_deg[1])


@pytest.mark.parametrize("step_s", [0.2, 0.65, 1.5])
def test_the_head_is_where_its_joints_get_in_one_step_of_the_robot(step_s):
    gait = GaitLimits(single_support_s=step_s / 2, double_support_s=step_s / 2)
    robot = RobotModel(gait=gait, head=HeadLimits(90.0, (0.0, 60.0), speed_radps=1.0))
    policy = _LooksLeft(GazeMapConfig(head=robot.head), robot)
    known = GazeContext(Gaussian(np.zeros(3), np.eye(3) * 1e-6))
    for k in range(1, 4):
        policy.next(0.0, Pose2(), np.zeros(2), (), known)
        assert policy.present.pan_rad == pytest.approx(min(k * step_s, math.pi / 2))


class _LooksLeft(MapGaze):
    """Values the leftmost direction."""

    def total(self, via, obstacles, known):
        found = np.zeros((len(self.map.pans), len(self.map.tilts)))
        found[-1] = 1.0
        return found
