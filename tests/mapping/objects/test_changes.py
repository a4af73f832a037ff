"""What changed between two sessions of a synthetic room: boxes that move, go and come, and nothing else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mapping.objects.changes import Look, _object, evidence, find_changes, surface_of
from perception.primitives.camera import Camera
from perception.primitives.pose import Pose3, head_rotation

CAMERA = Camera(160, 120, 120.0, 120.0, 79.5, 59.5)
ROOM = ((-2.5, -2.0, 0.0), (2.5, 2.0, 2.4))
STOOL = ((0.6, 0.4, 0.0), (1.0, 0.8, 0.5))
SHELF = ((-2.4, -0.6, 0.0), (-2.0, 0.6, 1.8))


def shifted(box, x, y):
    low, high = box
    return (low[0] + x, low[1] + y, low[2]), (high[0] + x, high[1] + y, high[2])


def looks(boxes, seed, offset_m=0.0):
    """Images all around the room from three places."""
    rng, found = np.random.default_rng(seed), []
    for x, y in ((-1.2, -1.2), (1.6, -1.2), (-0.6, 1.4)):
        for k in range(8):
            R = head_rotation(2 * np.pi * k / 8 + 0.1 * seed, 0.45)
            place = np.array([x + 0.1 * seed, y, 1.3])
            z = depth(boxes, Pose3.from_rotation(R, place))
            sigma = 0.0012 + 0.0019 * (z - 0.4) ** 2
            z = z + rng.standard_normal(z.shape) * sigma
            pose = Pose3.from_rotation(R, np.add(place, [offset_m, 0.0, 0.0]))
            found.append(Look(z.astype(np.float32), sigma.astype(np.float32), CAMERA, pose, 0.01))
    return found


def depth(boxes, pose):
    directions = CAMERA.rays @ pose.rotation.T
    z = np.full(directions.shape[:2], np.inf)
    for number, (low, high) in enumerate((ROOM, *boxes)):
        with np.errstate(divide="ignore"):
            first = (np.array(low) - pose.position) / directions
            second = (np.array(high) - pose.position) / directions
        near = np.minimum(first, second).max(axis=-1)
        far = np.maximum(first, second).min(axis=-1)
        hit = far if number == 0 else np.where((near < far) & (near > 0.0), near, np.inf)
        z = np.minimum(z, hit)
    return z


def middle(box):
    return (np.array(box[0]) + np.array(box[1]))[:2] / 2


@pytest.mark.parametrize("offset_m", [0.0, 0.02])
def test_a_room_that_did_not_change_has_no_changes(offset_m):
    assert find_changes(looks([STOOL, SHELF], 1), looks([STOOL, SHELF], 2, offset_m)) == []


def test_a_stool_that_moved_is_found_at_both_places_and_nothing_else():
    there = shifted(STOOL, -1.4, -1.0)
    found = find_changes(looks([STOOL, SHELF], 1), looks([there, SHELF], 2))
    assert [one.kind for one in found] == ["moved"]
    one = found[0]
    assert one.probability > 0.6
    for place, box in ((one.before, STOOL), (one.after, there)):
        off = place.position - middle(box)
        assert off @ np.linalg.solve(place.covariance, off) < 9.21  # 99 % of two dimensions
        np.testing.assert_allclose(place.size, [0.4, 0.4, 0.5], atol=0.1)
        sides = np.linalg.norm(np.diff(place.outline[:3], axis=0), axis=1)
        np.testing.assert_allclose(sorted(sides), sorted(place.size[:2]), atol=1e-6)


def test_sides_and_heights_go_half_a_voxel_beyond_the_points():
    """A crate of 0.4 x 0.4 x 0.2 m at a height of 0.6 m, filled with the middles of voxels."""
    x, y, z = 1.02 + 0.04 * np.arange(10), -0.18 + 0.04 * np.arange(10), 0.62 + 0.04 * np.arange(5)
    points = np.stack(np.meshgrid(x, y, z), axis=-1).reshape(-1, 3)
    one = _object(points, np.full(len(points), 0.9), np.ones(len(points)), 0.01)
    assert one is not None
    np.testing.assert_allclose(one.size, [0.4, 0.4, 0.8], atol=1e-6)
    assert one.low == pytest.approx(0.6)
    np.testing.assert_allclose(one.outline.min(axis=0), [1.0, -0.2], atol=1e-6)
    np.testing.assert_allclose(one.outline.max(axis=0), [1.4, 0.2], atol=1e-6)


@pytest.mark.parametrize(("kind", "before", "after"), [("gone", [STOOL, SHELF], [SHELF]), ("appeared", [SHELF], [STOOL, SHELF])])  # fmt: skip
def test_a_stool_that_went_or_came_is_found(kind, before, after):
    found = find_changes(looks(before, 1), looks(after, 2))
    assert [one.kind for one in found] == [kind]
    place = found[0].before or found[0].after
    assert np.linalg.norm(place.position - middle(STOOL)) < 0.1
    assert found[0].probability > 0.9


def test_two_things_of_different_size_are_not_one_that_moved():
    crate = ((-1.0, -1.6, 0.0), (-0.1, -1.0, 0.9))
    found = find_changes(looks([STOOL], 1), looks([crate], 2))
    assert sorted(one.kind for one in found) == ["appeared", "gone"]


def test_what_the_other_session_did_not_look_at_is_no_change():
    one_side = [look for look in looks([SHELF], 2) if look.T_map_camera.rotation[0, 2] < -0.3]
    first = looks([STOOL, SHELF], 1)
    assert any(np.linalg.norm(one.before.position - middle(STOOL)) < 0.1 for one in find_changes(first, looks([SHELF], 2)))  # fmt: skip
    found = find_changes(first, one_side)
    assert all(np.linalg.norm(one.before.position - middle(STOOL)) > 0.5 for one in found if one.before)  # fmt: skip
    assert find_changes(looks([STOOL], 1), []) == []


def test_a_place_behind_a_surface_is_neither_free_nor_filled():
    look = looks([STOOL], 1)[0]
    ahead = look.T_map_camera.apply(np.array([[0.0, 0.0, 0.6], [0.0, 0.0, 9.0]]))
    centre = float(look.z[59:61, 79:81].mean())
    at_and_behind = look.T_map_camera.apply(
        np.array([[0.0, 0.0, centre], [0.0, 0.0, centre + 0.5]])
    )
    free, filled = evidence(np.concatenate([ahead, at_and_behind]), [look])
    np.testing.assert_array_equal(free, [1, 0, 0, 0])
    np.testing.assert_array_equal(filled, [0, 0, 1, 0])


def test_a_larger_doubt_of_the_pose_finds_less():
    sure = find_changes(looks([STOOL], 1), looks([], 2))
    vague = [replace(look, sigma_m=0.2) for look in looks([], 2)]
    unsure = find_changes(looks([STOOL], 1), vague)
    assert sum(one.probability for one in unsure) < sum(one.probability for one in sure)


def test_the_surface_has_one_point_in_each_voxel():
    surface = surface_of(looks([STOOL], 1))
    cells = np.floor(surface.points / 0.04)
    assert len(np.unique(cells, axis=0)) >= 0.99 * len(cells)  # a mean may lie on a border
    assert surface.sightings.min() >= 1
    assert len(surface_of([]).points) == 0
