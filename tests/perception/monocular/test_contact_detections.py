"""Discs detected from contact edges, against rendered cylinders at known positions."""

import math

import numpy as np
import pytest

from perception.monocular import contact_detections
from perception.monocular.result import Flows, MonocularResult, Picture
from perception.primitives.camera import Camera
from perception.primitives.gaussian import Gaussian
from perception.primitives.obstacle import Obstacle
from perception.primitives.pose import Pose2, Pose3, head_rotation

CAMERA = Camera.from_view(720, 720, math.pi / 2, math.pi / 2)
EYE = Pose3.from_rotation(head_rotation(0.0, math.radians(30.0)), np.array([0.05, 0.0, 0.383]))
ROBOT = Pose2(0.4, -0.3, 0.7)


def ground_with(cylinders):
    """Ground image of a room with vertical cylinders (x, y, radius, height), body frame, by ray casting."""
    v, u = np.mgrid[0:720, 0:720].astype(float)
    rays = CAMERA.back_project(np.stack([u, v], axis=-1), np.ones((720, 720))) @ EYE.rotation.T
    eye = EYE.position
    with np.errstate(divide="ignore", invalid="ignore"):
        floor = eye[:2] - eye[2] / rays[..., 2:] * rays[..., :2]
    free = (rays[..., 2] < 0) & (np.hypot(*(floor - eye[:2]).transpose(2, 0, 1)) < 4.0)
    for x, y, radius, height in cylinders:
        for level in np.linspace(0.0, height, 12):
            at = eye[:2] + (floor - eye[:2]) * (1.0 - level / eye[2])
            free &= ~(np.hypot(at[..., 0] - x, at[..., 1] - y) < radius)
    return np.where(free, 255, 0).astype(np.uint8)


def contacts_of(ground):
    nothing = np.zeros((0, 2))
    picture = Picture(np.zeros((720, 720, 3), np.uint8), CAMERA, ROBOT.lifted() @ EYE, 0.0)
    return contact_detections.find_contact_edges(
        MonocularResult(
            None,
            picture,
            ground,
            np.zeros_like(ground),
            Flows(nothing, nothing, np.zeros((0, 2, 2)), np.zeros(0, np.int64), nothing),
            (),
            np.zeros_like(ground),
            ground,
            0.65,
            0.2,
            (False, False),
        )
    )


@pytest.mark.parametrize(("x", "y"), [(0.8, 0.0), (1.2, 0.6), (1.8, -0.5)])
@pytest.mark.parametrize(("radius", "height"), [(0.037, 0.055), (0.10, 0.25)])
def test_a_robot_is_detected_at_its_position(x, y, radius, height):
    seen = contacts_of(ground_with([(x, y, radius, height)]))
    found = contact_detections.detect_discs(seen, ROBOT, 2.5)
    assert len(found) == 1
    away = math.hypot(x, y)
    np.testing.assert_allclose(found[0].position, [x, y], atol=0.01 + 0.01 * away)
    assert found[0].radius_m == pytest.approx(radius, rel=0.15, abs=0.004)
    error = found[0].position - [x, y]
    assert error @ np.linalg.solve(found[0].covariance, error) < 4.0


@pytest.mark.parametrize(("x", "y"), [(0.36, 0.26), (0.30, 0.20), (0.45, -0.35), (0.6, 0.45)])
def test_a_robot_beside_the_feet_is_detected_despite_its_inclined_sides(x, y):
    seen = contacts_of(ground_with([(x, y, 0.037, 0.055)]))
    found = contact_detections.detect_discs(seen, ROBOT, 2.5)
    assert len(found) == 1
    np.testing.assert_allclose(found[0].position, [x, y], atol=0.006)
    assert found[0].radius_m == pytest.approx(0.037, abs=0.003)


def test_contact_points_lie_on_the_circumference():
    x, y = 0.36, 0.26
    seen = contacts_of(ground_with([(x, y, 0.037, 0.055)]))
    gaps = [np.hypot(*(contact - ROBOT.apply(np.array([x, y]))).T) for contact in seen.points_world]
    (gap,) = (gap for gap in gaps if gap.min() < 0.5)
    assert np.abs(gap - 0.037).max() < 0.008


def test_seams_and_small_regions_count_as_floor():
    ground = ground_with([])
    ground[500:504, 100:600] = 0
    ground[600:612, 300:330] = 0
    seen = contacts_of(ground)
    assert (seen.ground[480:, :] > 0).all()
    assert contact_detections.detect_discs(seen, ROBOT, 2.5) == []


@pytest.mark.parametrize("part", [np.s_[600:612, :30], np.s_[600:612, -30:], np.s_[-12:, 300:330]])
def test_a_small_region_at_the_border_may_be_the_tip_of_an_obstacle(part):
    ground = ground_with([])
    ground[part] = 0
    assert (contacts_of(ground).ground[part] == 0).all()


def test_a_wide_or_truncated_object_is_not_a_disc():
    wide = contacts_of(ground_with([(1.2, 0.0, 0.25, 0.3)]))
    assert contact_detections.detect_discs(wide, ROBOT, 2.5) == []
    cut = contacts_of(ground_with([(0.8, 0.84, 0.05, 0.2)]))
    assert contact_detections.detect_discs(cut, ROBOT, 2.5) == []


def test_a_partly_occluded_object_is_not_a_disc():
    front, behind = (0.8, 0.0, 0.06, 0.05), (1.0, 0.07, 0.06, 0.1)
    alone, both = (
        contact_detections.detect_discs(contacts_of(ground_with(cylinders)), ROBOT, 2.5)
        for cylinders in ([behind], [front, behind])
    )
    assert [abs(disc.position[1] - 0.07) < 0.01 for disc in alone] == [True]
    assert all(abs(disc.position[1] - 0.07) > 0.02 for disc in both)


def test_floor_is_visible_where_there_is_no_obstacle():
    seen = contacts_of(ground_with([(1.0, 0.0, 0.10, 0.2)]))
    places = ROBOT.apply(np.array([[0.6, 0.0], [1.0, 0.0], [1.15, 0.0], [-1.0, 0.0], [1.0, 0.4]]))
    assert seen.shows_floor(places).tolist() == [True, False, False, False, True]


def test_the_swept_area_of_a_moving_obstacle_is_not_free():
    seen = contacts_of(ground_with([]))
    velocity = ROBOT.rotation @ np.array([0.0, 0.3])
    place = ROBOT.apply(np.array([1.0, -0.2]))
    mover = Obstacle(Gaussian(np.concatenate([place, velocity]), np.eye(4) * 1e-4), 0.08)
    left = contact_detections.subtract_moving_obstacles(seen.ground, seen.picture, [mover], 1.0)
    taken = contacts_of(left).shows_floor(
        ROBOT.apply(np.array([[1.0, -0.2], [1.0, -0.05], [1.0, 0.1], [1.0, 0.25], [1.0, -0.35]]))
    )
    assert taken.tolist() == [False, False, False, True, True]
