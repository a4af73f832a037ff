"""The search for a scan in the map, in rooms made of line segments."""

from __future__ import annotations

import math

import numpy as np
import pytest

from perception.localisation.scan import Scan
from perception.localisation.scan_search import find
from perception.primitives.gaussian import Gaussian
from perception.primitives.pose import Pose2, wrap_angle

DEG = math.pi / 180
Walls = list[tuple[tuple[float, float], tuple[float, float]]]


def closed(*corners: tuple[float, float]) -> Walls:
    """Walls from corner to corner."""
    return list(zip(corners, (*corners[1:], corners[0]), strict=True))


ROOM = [*closed((0, 0), (4, 0), (4, 3), (0, 3)), ((2, 3), (2, 2.2))]
SQUARE = closed((-1.5, -1.5), (1.5, -1.5), (1.5, 1.5), (-1.5, 1.5))


def surfaces(walls: Walls, eye: tuple[float, float]) -> Scan:
    """Points every 4 cm of all walls, facing a place inside."""
    places, normals = [], []
    for a, b in np.array(walls, float):
        along = (b - a) / np.linalg.norm(b - a)
        normal = np.array([along[1], -along[0]])
        count = round(np.linalg.norm(b - a) / 0.04)
        places.append(a + np.linspace(0.0, 1.0, count)[:, None] * (b - a))
        inward = normal if normal @ (np.array(eye) - a) > 0 else -normal
        normals.append(np.tile(inward, (count, 1)))
    points = np.concatenate(places)
    return Scan(points, np.concatenate(normals), np.full(len(points), 0.003))


def seen_from(pose: Pose2, world: Scan, half_view_rad: float = 0.7) -> Scan:
    """What of these surfaces a sensor at this pose has in view, in its own frame."""
    level = world.at(pose.inverse())
    inside = np.abs(np.arctan2(level.points[:, 1], level.points[:, 0])) < half_view_rad
    return Scan(level.points[inside], level.normals[inside], level.sigmas[inside])


def prior(pose: Pose2, off: tuple[float, float, float], sigma: tuple[float, float, float]):
    """A Gaussian off the pose by this much."""
    return Gaussian(pose.vector + off, np.diag(np.square(sigma)))


@pytest.mark.parametrize(
    "off", [(0.0, 0.0, 0.0), (0.15, -0.1, 25 * DEG), (-0.1, 0.1, -30 * DEG), (0.05, 0.15, 20 * DEG)]
)
@pytest.mark.parametrize("pan", [0.3, 2.3, -2.4])
def test_the_pose_is_found_to_within_a_cell(off, pan):
    world = surfaces(ROOM, (1.0, 0.9))
    there = Pose2(1.0, 0.9, pan)
    found = find(
        seen_from(there, world), [(Pose2(), world)], prior(there, off, (0.15, 0.15, 25 * DEG))
    )
    assert found is not None
    assert math.hypot(found.x - there.x, found.y - there.y) < 0.08
    assert abs(wrap_angle(found.yaw - there.yaw)) < 4 * DEG


@pytest.mark.parametrize("turned", [-math.pi, -3.0, 2.5, 3.0, math.pi])
def test_half_a_turn_to_the_left_and_to_the_right_are_one_heading(turned):
    walls = [*closed((0, 0), (5, 0), (5, 3.5), (0, 3.5)), ((3, 3.5), (3, 2.5)), ((2, 0), (2, 0.6))]
    there = Pose2(2.3, 1.7, 0.3)
    world = surfaces(walls, (there.x, there.y))
    view = Pose2(there.x, there.y, 0.0)
    wide = prior(there, (0.0, 0.0, -turned), (0.05, 0.05, 2.0))
    found = find(world.at(there.inverse()), [(view, world.at(view.inverse()))], wide)
    assert found is not None
    assert math.hypot(found.x - there.x, found.y - there.y) < 0.08
    assert abs(wrap_angle(found.yaw - there.yaw)) < 4 * DEG


def test_a_place_that_fits_at_two_headings_is_not_found():
    world = surfaces(SQUARE, (0.0, 0.0))
    there = Pose2(0.0, 0.0, 0.2)
    seen = seen_from(there, world)
    assert (
        find(seen, [(Pose2(), world)], prior(there, (0.0, 0.0, 0.0), (0.1, 0.1, 60 * DEG))) is None
    )
    assert (
        find(seen, [(Pose2(), world)], prior(there, (0.0, 0.0, 0.2), (0.1, 0.1, 10 * DEG)))
        is not None
    )


def test_along_a_wall_the_prior_decides():
    world = surfaces([((-5.0, 1.0), (5.0, 1.0))], (0.0, 0.0))
    there = Pose2(0.0, 0.0, math.pi / 2)
    found = find(
        seen_from(there, world), [(Pose2(), world)], prior(there, (0.1, 0.2, 0.3), (0.08, 0.2, 0.3))
    )
    assert found is not None
    assert found.x == pytest.approx(0.1, abs=0.08)  # as the prior has it
    assert found.y == pytest.approx(0.0, abs=0.06)
    assert abs(wrap_angle(found.yaw - there.yaw)) < 4 * DEG


def test_a_place_that_the_map_lacks_is_not_found():
    world = surfaces(ROOM, (1.0, 0.9))
    corner = surfaces([((0.0, 1.2), (0.6, 1.2)), ((0.6, 1.2), (0.6, 0.3))], (0.0, 0.0))
    there = Pose2(1.6, 1.2, 0.3)
    assert (
        find(corner, [(Pose2(), world)], prior(there, (0.0, 0.0, 0.0), (0.1, 0.1, 10 * DEG)))
        is None
    )


def test_without_points_nothing_is_found():
    world, nothing = (
        surfaces(ROOM, (1.0, 0.9)),
        Scan(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0)),
    )
    there = prior(Pose2(1.0, 0.9, 0.0), (0.0, 0.0, 0.0), (0.1, 0.1, 0.1))
    assert find(nothing, [(Pose2(), world)], there) is None
    assert find(world, [], there) is None
