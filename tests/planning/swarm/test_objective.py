"""The objective against independent geometry, and the errors of the printed formulas."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from perception.primitives.camera import Camera
from perception.primitives.errors import ConfigError, InputError
from perception.primitives.pose import Pose2, Pose3, head_rotation
from perception.primitives.robot_model import DARWIN_OP
from planning.swarm import search
from planning.swarm._objective_kernels import between_blocked
from planning.swarm.floor_rows import FloorRows, upright
from planning.swarm.objective import PRINTED, Objective, ObjectiveConfig

CAMERA = Camera.from_view(160, 160, math.pi / 2, math.pi / 2)
CONFIG = ObjectiveConfig()


def eye(tilt_deg=30.0, pan_deg=0.0, height=0.383, roll=0.0):
    turned = Pose3(quat_xyzw=(0.0, 0.0, math.sin(roll / 2), math.cos(roll / 2)))
    rotation = head_rotation(math.radians(pan_deg), math.radians(tilt_deg))
    return Pose3.from_rotation(rotation, np.array([0.05, 0.01, height])) @ turned


def objective(movable, goal=(3.0, 0.0), robot=None, config=CONFIG, sides=(False, False), T=None):
    return Objective.of(
        movable, CAMERA, T or eye(), robot or Pose2(), np.array(goal), config, sides
    )


def all_floor():
    return np.full((160, 160), 255, np.uint8)


def disc_floor(middle, radius, T=None):
    """All floor but the image of a flat disc."""
    v, u = np.mgrid[0:160, 0:160].astype(float)
    floor = FloorRows.of(CAMERA, T or eye()).floor_of(np.stack([u.ravel(), v.ravel()], axis=1))
    inside = np.hypot(*(floor - np.array(middle)).T) < radius
    return np.where(inside, 0, 255).astype(np.uint8).reshape(160, 160)


@given(
    st.floats(5.0, 60.0),
    st.floats(-40.0, 40.0),
    st.floats(0.2, 1.0),
    st.floats(5, 154),
    st.floats(90, 154),
)
def test_a_pixel_goes_to_the_floor_and_back(tilt, pan, height, u, v):
    T = eye(tilt, pan, height)
    point = FloorRows.of(CAMERA, T).floor_of(np.array([[u, v]]))
    if np.isfinite(point).all() and np.abs(point).max() < 50.0:
        back = CAMERA.project(T.inverse().apply(np.append(point[0], 0.0)))
        np.testing.assert_allclose(back, [u, v], atol=1e-6)


def test_rows_above_the_horizon_have_no_floor():
    rows = FloorRows.of(CAMERA, eye())
    horizon = CAMERA.cy - CAMERA.fy * math.tan(math.radians(30.0))
    above = np.arange(160) < horizon
    assert np.isnan(rows.ahead[above]).all()
    assert np.isfinite(rows.ahead[~above]).all()


def test_the_picture_of_a_rolled_camera_is_rotated_upright():
    straight = disc_floor((1.0, 0.3), 0.2)
    T = eye(roll=0.1)
    v, u = np.mgrid[0:160, 0:160].astype(float)
    rays = CAMERA.back_project(np.stack([u, v], axis=-1), np.ones((160, 160)))
    way = rays @ T.rotation.T
    with np.errstate(divide="ignore", invalid="ignore"):
        floor = T.position[:2] - T.position[2] / way[..., 2:] * way[..., :2]
    inside = (np.hypot(*(floor - [1.0, 0.3]).transpose(2, 0, 1)) < 0.2) & (way[..., 2] < 0)
    turned = upright(np.where(inside, 0, 255).astype(np.uint8), CAMERA, T)
    middle = np.s_[30:130, 30:130]
    assert np.mean(turned[middle] != straight[middle]) < 0.01


def test_wedges_of_a_large_roll_are_blocked():
    """Twenty degrees turn in a corner of the picture that nobody saw."""
    turned = upright(all_floor(), CAMERA, eye(roll=math.radians(20.0)))
    assert (turned[-1, [0, -1]] == 0).any()
    assert turned[80, 80] > 0


@pytest.mark.parametrize("roll_deg", [-3.0, -1.0, 1.0, 3.0])
def test_on_bare_floor_a_roll_blocks_nothing(roll_deg):
    straight = search.exact(objective(all_floor(), goal=(1.5, 0.2)))
    leaning = objective(all_floor(), goal=(1.5, 0.2), T=eye(roll=math.radians(roll_deg)))
    found = search.exact(leaning)
    assert found is not None
    assert found.value == pytest.approx(straight.value, abs=0.02)


def test_on_bare_floor_the_value_is_the_distance_to_the_goal():
    o = objective(all_floor(), goal=(2.0, 0.5), robot=Pose2(0.3, -0.2, 0.2))
    pixel = (90, 100)
    away = np.linalg.norm(o.place(pixel) - [2.0, 0.5])
    assert o.value(np.array([pixel], float))[0] == pytest.approx(away, abs=1e-9)


def corridor_free(movable, T, target, config):
    """p2 the slow way: dense floor points of the corridor, each projected."""
    half = DARWIN_OP.width_m / 2 + config.margin_m
    reach = np.linalg.norm(target)
    along, left = target / reach, np.array([-target[1], target[0]]) / reach
    aside = np.linspace(-half, half, 15)
    points = [s * along + side * left for s in np.linspace(0, reach, 400) for side in aside]
    pixels = CAMERA.project(T.inverse().apply(np.column_stack([points, np.zeros(len(points))])))
    seen = CAMERA.contains(pixels)
    u, v = np.rint(pixels[seen]).astype(int).T
    return bool((movable[v, u] > 0).all())


@settings(max_examples=40, deadline=None)
@given(
    st.floats(0.5, 1.8),
    st.floats(-0.5, 0.5),
    st.floats(0.05, 0.3),
    st.floats(0.5, 2.5),
    st.floats(-0.9, 0.9),
)
def test_the_corridor_is_straight_on_the_floor(x, y, radius, ahead, left):
    """Disagreement is allowed where one pixel more or less of the disc decides."""
    target = np.array([ahead, left])
    if math.hypot(ahead - x, left - y) < radius + 0.3:
        return
    T = eye()
    u, v = np.rint(CAMERA.project(T.inverse().apply(np.append(target, 0.0)))).astype(int)
    if not (20 < u < 140 and 60 < v < 140):
        return
    place = FloorRows.of(CAMERA, T).floor_of(np.array([[u, v]], float))[0]
    smaller, larger = (disc_floor((x, y), radius * f) for f in (0.85, 1.15))
    answers = [
        objective(mask).value(np.array([[u, v]], float))[0] < CONFIG.penalty
        for mask in (smaller, larger)
    ]
    free = corridor_free(disc_floor((x, y), radius), T, place, CONFIG)
    assert answers[0] >= free >= answers[1] or answers[0] == answers[1] == free


def test_a_place_whose_footprint_touches_an_obstacle_is_forbidden():
    o = objective(disc_floor((1.2, 0.0), 0.1))
    beside = CAMERA.project(eye().inverse().apply(np.array([1.2, 0.16, 0.0])))
    clear = CAMERA.project(eye().inverse().apply(np.array([1.2, 0.35, 0.0])))
    value = o.value(np.stack([beside, clear]))
    assert value[0] >= CONFIG.penalty > value[1]


@pytest.mark.parametrize("pan", [0.0, 30.0])
def test_no_allowed_pixel_has_a_corner_of_the_footprint_outside_the_picture(pan):
    """The near corners are wider in the picture; all four are projected."""
    T = eye(pan_deg=pan)
    v, u = np.mgrid[0:160, 0:160]
    pixels = np.stack([u.ravel(), v.ravel()], axis=1).astype(float)
    wide = replace(CONFIG, window_steps=8)
    free = pixels[objective(all_floor(), config=wide, T=T).value(pixels) < CONFIG.penalty]
    assert len(free) > 1000
    floor = FloorRows.of(CAMERA, T)
    places = floor.floor_of(free)
    c, s = math.cos(floor.heading_rad), math.sin(floor.heading_rad)
    deep, half = DARWIN_OP.depth_m / 2 + CONFIG.margin_m, DARWIN_OP.width_m / 2 + CONFIG.margin_m
    for ahead in (-deep, deep):
        for left in (-half, half):
            corner = places + np.array([c * ahead - s * left, s * ahead + c * left])
            seen = CAMERA.project(
                T.inverse().apply(np.column_stack([corner, np.zeros(len(corner))]))
            )
            assert seen[:, 0].min() >= -0.51
            assert seen[:, 0].max() <= 159.51
            assert seen[:, 1].max() <= 159.51


def test_a_place_behind_an_obstacle_is_forbidden():
    behind = CAMERA.project(eye().inverse().apply(np.array([1.8, 0.0, 0.0])))
    pixel = behind[None]
    assert objective(all_floor()).value(pixel)[0] < CONFIG.penalty
    assert objective(disc_floor((1.0, 0.0), 0.1)).value(pixel)[0] >= CONFIG.penalty


@settings(deadline=None)
@given(st.floats(0.03, 0.09), st.floats(0.45, 1.2), st.floats(-0.06, 0.06))
def test_an_obstacle_between_the_edges_of_the_corridor_blocks_it(radius, ahead, left):
    """A robot of 74 mm fits between them; the nearest free pixel to a goal behind it goes round."""
    o = objective(disc_floor((ahead, left), radius), goal=(1.8, 0.0))
    behind = CAMERA.project(eye().inverse().apply(np.array([1.8, 0.0, 0.0])))
    assert o.value(behind[None])[0] >= CONFIG.penalty
    best = search.exact(o)
    place = o.place(best.pixel)
    direction = place / np.linalg.norm(place)
    passed = min(max(float(direction @ [ahead, left]), 0.0), float(np.linalg.norm(place)))
    assert np.linalg.norm(passed * direction - [ahead, left]) > radius + DARWIN_OP.width_m / 2


def test_pixels_between_two_lines_are_counted_where_the_lines_leave_the_picture():
    rng = np.random.default_rng(0)
    answers = []
    for _ in range(300):
        blocked = rng.random((12, 16)) < 0.02
        integral = np.pad(np.cumsum(np.cumsum(blocked, 0), 1), ((1, 0), (1, 0)))
        (a, c), (b, d) = np.sort(rng.uniform(-12.0, 28.0, 2)), rng.uniform(-1.0, 1.0, 2)
        first = rng.uniform(-1.0, 11.0)
        v, u = np.mgrid[0:12, 0:16]
        inside = (np.floor(a + b * v + 0.5) <= u) & (u <= np.floor(c + d * v + 0.5)) & (v >= first)
        answers.append((blocked & inside).any())
        assert between_blocked(integral, a, b, c, d, first) == answers[-1]
    assert 50 < sum(answers) < 250


def test_a_place_beyond_the_turn_of_four_steps_is_forbidden():
    narrow = replace(CONFIG, window_steps=1)
    aside = CAMERA.project(eye().inverse().apply(np.array([1.0, 0.4, 0.0])))[None]  # 21.8 deg
    assert objective(all_floor()).value(aside)[0] < CONFIG.penalty
    assert objective(all_floor(), config=narrow).value(aside)[0] >= CONFIG.penalty


@pytest.mark.parametrize("side", [0, 1])
def test_the_side_of_an_obstacle_beside_the_feet_is_closed(side):
    sides = (side == 0, side == 1)
    pixels = np.array([[60.0, 100.0], [100.0, 100.0]])
    value = objective(all_floor(), sides=sides).value(pixels)
    assert (value >= CONFIG.penalty).tolist() == [side == 0, side == 1]


def test_the_heading_counts_and_the_printed_form_ignores_it():
    goal, behind = (-3.0, 0.0), Pose2(yaw=math.pi)
    pixel = np.array([[80.0, 100.0]])
    assert objective(all_floor(), goal, behind).value(pixel)[0] < CONFIG.penalty
    printed = objective(all_floor(), goal, behind, replace(PRINTED, penalty=1e3))
    assert printed.value(pixel)[0] >= 1e3


def test_with_the_printed_penalties_a_pixel_behind_an_obstacle_wins():
    """One metre and a half nearer the goal outweighs a penalty of 1: the reason for infinity."""
    movable = disc_floor((0.9, 0.0), 0.25)
    north = Pose2(yaw=math.pi / 2)  # where the printed angles are right
    goal = (0.0, 4.0)
    far = CAMERA.project(eye().inverse().apply(np.array([2.6, 0.0, 0.0])))[None]
    near = CAMERA.project(eye().inverse().apply(np.array([0.45, 0.0, 0.0])))[None]
    printed = objective(movable, goal, north, PRINTED)
    mended = objective(movable, goal, north)
    assert printed.value(far)[0] < printed.value(near)[0]
    assert mended.value(far)[0] > mended.value(near)[0]


def test_a_picture_of_another_size_is_refused():
    with pytest.raises(InputError, match="80x160 px, the camera 160x160"):
        objective(np.zeros((160, 80), np.uint8))


def test_a_distorted_lens_is_refused():
    bent = replace(CAMERA, distortion=(0.1, 0.0, 0.0, 0.0, 0.0))
    with pytest.raises(InputError, match="rectify"):
        FloorRows.of(bent, eye())


def test_a_camera_on_its_side_is_refused():
    with pytest.raises(InputError, match="rolls by 60 deg"):
        upright(all_floor(), CAMERA, eye(roll=math.radians(60.0)))


def test_impossible_values_are_refused():
    with pytest.raises(ConfigError, match="penalty=0"):
        ObjectiveConfig(penalty=0.0)
    with pytest.raises(ConfigError, match="window_steps=0"):
        ObjectiveConfig(window_steps=0)
