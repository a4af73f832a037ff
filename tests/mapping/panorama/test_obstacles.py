"""Obstacles and gaps as values: closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapping.panorama import level_sets
from mapping.panorama.obstacles import PanoramaObstacle, Surroundings, gaps_between
from perception.primitives.errors import InputError

ENDS = math.radians(80.0), math.radians(-80.0)


def row(*faces):
    """Faces across the way from (left, right, distance), left to right."""
    return tuple(PanoramaObstacle.across(left, right, d, 0.3) for left, right, d in faces)


@given(st.floats(0.3, 2.0), st.floats(-0.5, 0.2), st.floats(0.05, 0.8))
def test_a_face_across_has_the_width_its_angles_tell(distance, right, width):
    face = PanoramaObstacle.across(right + width, right, distance, 0.3)
    told = distance * (math.tan(face.left_rad) - math.tan(face.right_rad))
    assert told == pytest.approx(face.width_m, abs=1e-9)
    assert face.left_rad > face.bearing_rad > face.right_rad


@given(st.floats(0.05, 0.6), st.floats(0.8, 1.5), st.floats(0.8, 1.5))
def test_a_gap_is_the_free_width_across_whatever_the_distances(free, near, far):
    obstacles = row((0.9, 0.5, near), (0.5 - free, -0.4, far))
    gap = gaps_between(obstacles, ENDS, 2.5)[1]
    assert gap.width_m == pytest.approx(free, abs=1e-9)
    assert gap.distance_m == max(near, far)
    assert (gap.left, gap.right) == (0, 1)


def test_there_is_a_gap_at_either_end_and_it_ends_with_the_panorama():
    gaps = gaps_between(row((0.4, -0.4, 1.0)), ENDS, 2.5)
    assert len(gaps) == 2
    for gap in gaps:
        assert gap.width_m == pytest.approx(math.tan(ENDS[0]) - 0.4)


def test_what_is_too_far_makes_no_gap():
    near_only = gaps_between(row((0.9, 0.5, 1.0), (0.2, -0.2, 2.6), (-0.5, -0.9, 1.0)), ENDS, 2.5)
    assert [(gap.left, gap.right) for gap in near_only] == [(None, 0), (0, 2), (2, None)]
    assert near_only[1].width_m == pytest.approx(1.0)


def test_overlapping_neighbours_leave_no_way():
    gap = gaps_between(row((0.5, 0.0, 1.0), (0.1, -0.4, 1.5)), ENDS, 2.5)[1]
    assert gap.width_m == pytest.approx(-0.1)


def test_the_gap_beside_an_obstacle_is_found_on_either_side():
    obstacles = row((0.9, 0.5, 1.0), (0.1, -0.4, 1.0))
    seen = Surroundings(obstacles, gaps_between(obstacles, ENDS, 2.5))
    assert len(seen) == 2
    assert seen.gap_beside(1, left=True) is seen.gap_beside(0, left=False)
    assert seen.gap_beside(5, left=True) is None


def test_without_obstacles_there_is_nothing_to_pass_between():
    assert gaps_between((), ENDS, 2.5) == ()


def test_bad_obstacles_are_named():
    with pytest.raises(InputError, match="positive to the left"):
        PanoramaObstacle(0.0, 0.1, 1.0, 0.1, 0.3)
    with pytest.raises(InputError, match="distance_m"):
        PanoramaObstacle(0.1, 0.0, -1.0, 0.1, 0.3)


def sliced(forward):
    """Things of an image of forward distances, by slices of 5 cm."""
    forward = np.asarray(forward, np.float32)
    return level_sets.merged(level_sets.label(level_sets.levels(forward)), forward, 2, 0.05, 4)


def test_a_face_on_the_border_of_two_slices_is_one_thing():
    rng = np.random.default_rng(0)
    forward = 1.05 + 0.004 * rng.standard_normal((20, 30))
    assert level_sets.label(level_sets.levels(forward.astype(np.float32))).labels.max() > 1
    assert sliced(forward).max() == 1


def test_things_side_by_side_at_different_distances_are_two():
    forward = np.full((20, 30), 1.02)
    forward[:, 15:] = 1.12
    assert sliced(forward).max() == 2


def test_a_slanted_face_through_many_slices_is_one_thing():
    forward = np.tile(np.linspace(0.8, 1.4, 60), (20, 1))
    assert sliced(forward).max() == 1


def test_specks_are_left_out_and_numbers_follow_reading_order():
    forward = np.full((20, 30), np.nan)
    forward[2, 2] = 1.0
    forward[4:8, 20:26] = 1.0
    forward[10:14, 3:9] = 1.6
    found = sliced(forward)
    assert found[2, 2] == 0
    assert found[5, 22] == 1
    assert found[11, 5] == 2
