"""Gaps in panoramas of nine views, with all errors of camera and head, against where the objects stand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mapping.panorama.sizes import surroundings
from mapping.panorama.stitching import stitch
from sim.shapes import Box
from surefoot.experiments.seed_004.panorama_scenes import (
    compare,
    nine_views,
    panorama_of,
    placed,
    scene_of,
)


def box(x, y, depth, width, height, yaw=0.0):
    return placed(Box((x, y, height / 2), (depth, width, height), yaw))


def gap_of(objects, seed):
    """The gap between the first two objects from the left, and its true width."""
    rng = np.random.default_rng([seed, 71])
    views, _ = nine_views(scene_of(objects, rng), rng)
    found = surroundings(stitch(views, rng), views)
    (gap,) = [one for one in found.gaps if (one.left, one.right) == (0, 1)]
    return gap, objects[0].right_m - objects[1].left_m


def test_corners_on_both_sides_of_straight_ahead_are_seen_and_bound_the_gap_to_a_centimetre():
    gap, true = gap_of([box(1.3, 0.5, 0.3, 0.4, 0.4), box(1.1, -0.4, 0.2, 0.3, 0.5)], 0)
    assert gap.corners_seen == 2
    assert gap.width_m == pytest.approx(true, abs=0.01)
    assert gap.sigma_width_m < 0.015


@pytest.mark.parametrize("height", [0.35, 0.59])  # below the camera, and as high
def test_a_hidden_corner_bounds_the_gap_from_one_side_only(height):
    """The inner box shows one face, and its far corner protrudes 0.14 m into the gap."""
    turned = math.atan2(0.55, 1.2)
    objects = [box(1.3, 1.5, 0.2, 0.4, 0.5), box(1.2, 0.55, 0.4, 0.16, height, turned)]
    gap, true = gap_of(objects, 1)
    seen = objects[0].right_m - 1.12 * math.sin(objects[1].left_rad)  # by the front face alone
    assert seen - true > 0.1
    assert gap.corners_seen == 1
    assert abs(gap.width_m - true) < 2.0 * gap.sigma_width_m
    assert gap.width_m - 2.0 / 3.0 * gap.hidden_m - 0.02 < true
    assert true < gap.width_m + gap.hidden_m / 3.0 + 0.02


@pytest.fixture(scope="module")
def random_scenes():
    """Objects and what is found of them, in scenes that nothing was chosen on."""
    found = []
    for seed in range(400, 405):
        objects, panorama, views = panorama_of(seed)
        found.append((objects, surroundings(panorama, views)))
    return found


def test_widths_hold_the_error_of_a_corner_that_protrudes_beside_an_edge(random_scenes):
    """On the side that is turned to straight ahead, where nothing of an object is hidden."""
    errors = []
    for objects, found in random_scenes:
        if len(objects) != len(found):
            continue
        for true, one in zip(objects, found.obstacles, strict=True):
            if one.left_edge_m[1] < 0.0:
                errors.append((one.left_edge_m[1] - true.left_m) / one.sigma_width_m)
            if one.right_edge_m[1] > 0.0:
                errors.append((one.right_edge_m[1] - true.right_m) / one.sigma_width_m)
    assert len(errors) >= 10
    assert np.sqrt(np.mean(np.square(errors))) < 1.5


def test_gaps_between_random_objects_hold_their_claim(random_scenes):
    scores = [compare(objects, found) for objects, found in random_scenes]
    gaps = [gap for one in scores for gap in one.gaps]
    assert len(gaps) >= 5
    assert any(not gap.seen for gap in gaps)
    assert max(gap.in_sigmas for gap in gaps) < 3.0
    assert np.mean([abs(gap.in_sigmas) <= 2.0 for gap in gaps]) >= 0.9
    assert max(abs(gap.error_m) for gap in gaps if gap.seen) < 0.03


def test_a_gap_that_is_not_there_is_not_listed():
    objects = [box(1.1, 0.35, 0.2, 0.3, 0.3), box(1.9, 0.0, 0.2, 0.5, 0.5)]
    assert objects[0].right_m < objects[1].left_m
    rng = np.random.default_rng(5)
    views, _ = nine_views(scene_of(objects, rng), rng)
    found = surroundings(stitch(views, rng), views)
    inner = [gap for gap in found.gaps if gap.left is not None and gap.right is not None]
    assert all(gap.width_m > 0.0 for gap in inner)
    assert all(math.isnan(gap.width_m) for gap in found.gaps if gap not in inner)
    assert (0, 1) not in [(gap.left, gap.right) for gap in found.gaps]
    assert compare(objects, found).unlisted_m == []
