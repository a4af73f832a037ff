"""Obstacles and gaps against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapping.panorama import level_sets
from mapping.panorama.obstacles import PanoramaObstacle, gaps_between
from perception.primitives.errors import InputError

ENDS = math.radians(80.0), math.radians(-80.0)


def row(*faces):
    """Faces perpendicular to x from (left, right, distance), left to right."""
    return tuple(PanoramaObstacle.across(left, right, d, 0.3) for left, right, d in faces)


@given(st.floats(0.3, 2.0), st.floats(-0.5, 0.2), st.floats(0.05, 0.8))
def test_the_width_of_a_face_follows_from_its_angles(distance, right, width):
    face = PanoramaObstacle.across(right + width, right, distance, 0.3)
    by_angles = distance * (math.tan(face.left_rad) - math.tan(face.right_rad))
    assert by_angles == pytest.approx(face.width_m, abs=1e-9)
    assert face.left_rad > face.bearing_rad > face.right_rad


@given(st.floats(0.05, 0.6), st.floats(0.8, 1.5), st.floats(0.8, 1.5))
def test_a_gap_has_the_free_lateral_width_at_any_distances(free, near, far):
    obstacles = row((0.9, 0.5, near), (0.5 - free, -0.4, far))
    gap = gaps_between(obstacles, ENDS, 2.5)[1]
    assert gap.width_m == pytest.approx(free, abs=1e-9)
    assert gap.distance_m == max(near, far)
    assert (gap.left, gap.right) == (0, 1)


def test_a_gap_at_either_end_extends_to_the_end_of_the_panorama_and_has_no_width():
    gaps = gaps_between(row((0.4, -0.4, 1.0)), ENDS, 2.5)
    assert [(gap.left_rad, gap.right_rad) for gap in gaps] == [
        (ENDS[0], math.atan(0.4)),
        (-math.atan(0.4), ENDS[1]),
    ]
    assert all(math.isnan(gap.width_m) and math.isnan(gap.sigma_width_m) for gap in gaps)


def test_an_obstacle_beyond_the_end_of_the_panorama_leaves_no_gap_there():
    assert gaps_between(row((9.0, -9.0, 1.0)), ENDS, 2.5) == ()


def test_obstacles_beyond_the_farthest_level_bound_no_gap():
    near_only = gaps_between(row((0.9, 0.5, 1.0), (0.2, -0.2, 2.6), (-0.5, -0.9, 1.0)), ENDS, 2.5)
    assert [(gap.left, gap.right) for gap in near_only] == [(None, 0), (0, 2), (2, None)]
    assert near_only[1].width_m == pytest.approx(1.0)


def test_overlapping_neighbours_leave_no_gap():
    gaps = gaps_between(row((0.5, 0.0, 1.0), (0.1, -0.4, 1.5)), ENDS, 2.5)
    assert [(gap.left, gap.right) for gap in gaps] == [(None, 0), (1, None)]


def test_without_obstacles_there_are_no_gaps():
    assert gaps_between((), ENDS, 2.5) == ()


def test_impossible_obstacles_are_refused():
    with pytest.raises(InputError, match="positive to the left"):
        PanoramaObstacle(0.0, 0.1, 1.0, 0.1, 0.3)
    with pytest.raises(InputError, match="distance_m"):
        PanoramaObstacle(0.1, 0.0, -1.0, 0.1, 0.3)


def segmented(forward):
    """Obstacles of an image of forward distances, by levels of 5 cm."""
    forward = np.asarray(forward, np.float32)
    return level_sets.merge_parts(level_sets.label(level_sets.levels(forward)), forward, 2, 0.05, 4)


def test_a_face_on_the_border_of_two_levels_is_one_obstacle():
    rng = np.random.default_rng(0)
    forward = 1.05 + 0.004 * rng.standard_normal((20, 30))
    assert level_sets.label(level_sets.levels(forward.astype(np.float32))).labels.max() > 1
    assert segmented(forward).max() == 1


def test_neighbours_at_different_distances_are_two_obstacles():
    forward = np.full((20, 30), 1.02)
    forward[:, 15:] = 1.12
    assert segmented(forward).max() == 2


def test_an_oblique_face_through_many_levels_is_one_obstacle():
    forward = np.tile(np.linspace(0.8, 1.4, 60), (20, 1))
    assert segmented(forward).max() == 1


def test_small_parts_are_dropped_and_labels_follow_reading_order():
    forward = np.full((20, 30), np.nan)
    forward[2, 2] = 1.0
    forward[4:8, 20:26] = 1.0
    forward[10:14, 3:9] = 1.6
    found = segmented(forward)
    assert found[2, 2] == 0
    assert found[5, 22] == 1
    assert found[11, 5] == 2
