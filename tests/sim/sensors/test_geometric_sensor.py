"""The geometric sensor: detections and errors against geometry and the claimed covariance."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sim.sensors.geometric_sensor import GeometricSensor

TILT = math.radians(28.0)
WALLS = np.array([-3.0, -3.0, 3.0, 3.0])


def sensor(seed=0):
    return GeometricSensor(np.random.default_rng(seed))


LOOKS = 60


def looks(discs, pan=0.0, colour=True, seed=0):
    """All detections of some looks at the same discs."""
    one = sensor(seed)
    return [
        found for _ in range(LOOKS) for found in one.look(np.array(discs, float), pan, TILT, colour)
    ]


def indices(discs, pan=0.0, colour=True, whole=True):
    """Discs that some look gives as whole, or as truncated."""
    return {found.index for found in looks(discs, pan, colour) if found.whole == whole}


def test_discs_ahead_are_detected_and_those_behind_are_not():
    assert indices([[1.0, 0.0, 0.1], [-1.0, 0.0, 0.1]]) == {0}
    assert indices([[1.0, 0.0, 0.1], [0.0, 1.0, 0.1]], pan=math.pi / 2) == {1}


def test_hidden_discs_are_not_detected():
    assert indices([[0.8, 0.0, 0.1], [1.6, 0.0, 0.1], [1.6, 0.9, 0.1]]) == {0, 2}


def test_a_partly_hidden_disc_is_truncated_to_its_visible_side_by_the_depth_camera():
    discs = [[0.8, 0.0, 0.05], [1.6, 0.10, 0.1]]
    seen = [one for one in looks(discs, colour=False) if one.index == 1]
    assert seen
    assert not any(one.whole for one in seen)
    assert np.mean([one.radius_m for one in seen]) < 0.07
    assert np.mean([one.position[1] for one in seen]) > 0.12
    assert np.mean([np.hypot(*one.position) for one in seen]) < 1.59  # the front is where it was


def test_the_colour_camera_takes_some_partly_hidden_discs_for_smaller_whole_ones():
    discs = [[0.8, 0.0, 0.05], [1.6, 0.10, 0.1]]
    seen = [one.radius_m for one in looks(discs) if one.index == 1 and one.whole]
    assert 0 < len(seen) < LOOKS / 2
    assert max(seen) < 0.09


def test_far_discs_are_whole_in_fewer_frames_and_misses_last():
    """The shares of the frames from images; a miss is likelier after a miss."""
    near, far = (
        np.array([one.whole for one in looks([[away, 0.0, 0.1]], colour=False)])
        for away in (0.8, 2.0)
    )
    assert near.all()
    assert len(far) == LOOKS
    assert 0.4 < far.mean() < 0.85
    many = np.concatenate(
        [[o.whole for o in looks([[2.0, 0.0, 0.1]], colour=False, seed=k)] for k in range(20)]
    )
    again = np.mean(~many[1:][~many[:-1]])
    assert again > np.mean(~many) + 0.1


def test_the_colour_camera_has_the_wider_field_of_view():
    lateral = [[1.0, 0.7, 0.1]]  # 35 degrees off
    assert indices(lateral) == {0}
    assert indices(lateral, colour=False) == set()


def test_discs_cut_by_the_edge_of_the_view_are_truncated():
    edge = math.radians(22.0)
    inside, cut = edge - 0.11, edge - 0.05  # a disc of 10 cm at 1 m is 0.1 rad wide to each side
    for bearing, seen in ((inside, {0}), (cut, set())):
        disc = [[1.05 * math.cos(bearing), 1.05 * math.sin(bearing), 0.1]]
        assert indices(disc, colour=False) == seen
        assert 0 in indices(disc, colour=False, whole=bool(seen))


def test_discs_out_of_range_are_not_detected():
    assert indices([[2.8, 0.0, 0.1]]) == indices([[2.8, 0.0, 0.1]], whole=False) == set()


@pytest.mark.parametrize("place", [(0.7, 0.1), (1.5, -0.9)])
def test_errors_agree_with_the_claimed_covariance(place):
    """Over many runs the normalised squared error is that of two dimensions, or less."""
    squares = []
    for seed in range(300):
        for one in sensor(seed).look(np.array([[*place, 0.1]]), 0.0, TILT, True):
            away = one.position - np.array(place)
            squares.append(float(away @ np.linalg.solve(one.covariance, away)))
    assert len(squares) > 200
    assert 0.8 < np.mean(squares) < 3.0


def test_rays_end_at_the_nearest_disc_or_wall():
    discs = np.array([[1.0, 0.0, 0.1], [2.0, 0.0, 0.1], [0.0, 2.0, 0.5]])
    rays = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, math.pi / 2], [0.0, 0.0, math.pi]])
    distance, what = sensor().rays(discs, WALLS, rays)
    np.testing.assert_allclose(distance, [0.9, 1.5, 3.0])
    assert what.tolist() == [0, 2, -1]
