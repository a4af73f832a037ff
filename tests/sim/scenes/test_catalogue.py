"""Scenes: loadable, passable, with free space for moving objects."""

import math
from functools import cache

import numpy as np
import pytest

from perception.primitives.errors import InputError
from sim.free_space import clearance_map
from sim.scenes import catalogue
from sim.scenes.tags import IN_VIEW_M, _visible
from sim.scenes.tags import _Spot as Spot
from sim.shapes import distance
from sim.world import World

SEEDS = range(20)


@pytest.fixture(scope="module")
def homes():
    return [catalogue.load("home", seed) for seed in SEEDS]


@cache
def space(scene):
    return clearance_map(scene.extent, [p for t in scene.static_objects for p in t.parts])


def test_an_unknown_scene_is_reported_with_the_known_ones():
    with pytest.raises(InputError, match=r"'hom' is unknown; did you mean 'home'.*corridor"):
        catalogue.load("hom", 0)


def test_a_negative_seed_is_refused():
    with pytest.raises(InputError, match="seed -1"):
        catalogue.load("home", -1)


@pytest.mark.parametrize("name", catalogue.names())
def test_the_same_seed_gives_the_same_scene_and_another_seed_another(name):
    first = catalogue.load(name, 4)
    assert first == catalogue.load(name, 4)
    assert first != catalogue.load(name, 5)


def test_every_home_can_be_crossed(homes):
    for scene in homes:
        start = (scene.start.x, scene.start.y)
        reach = space(scene).reachable(start, 0.28)
        for goal in scene.goals:
            assert reach[space(scene).cell(goal)], scene.seed


def test_every_home_has_obstacles_near_the_path(homes):
    for scene in homes:
        assert math.dist((scene.start.x, scene.start.y), scene.goals[0]) >= 4.0
        assert len(scene.obstacles) >= 8
        assert 2 <= len(scene.moving_objects) <= 3
        assert 16 <= len(scene.landmarks) <= 24
        way = space(scene).path((scene.start.x, scene.start.y), scene.goals[0], 0.28)
        near = 0
        for item in scene.obstacles:
            near += min(distance(part, way).min() for part in item.parts) < 1.0
        for moving_object in scene.moving_objects:
            line = np.array(
                [moving_object.state(s)[:2] for s in np.linspace(0, moving_object.reversal_s, 12)]
            )
            near += np.linalg.norm(way[:, None] - line[None], axis=2).min() < 1.0
        assert near >= 6, scene.seed


def test_moving_objects_stay_in_free_space_and_away_from_the_start(homes):
    for scene in homes:
        still = space(scene)
        with World(scene, "tiny", scene.seed) as world:
            for _ in range(120):
                for moving_object, (x, y, vx, vy) in zip(
                    scene.moving_objects, world.moving_states(), strict=True
                ):
                    assert still.at((x, y)) > moving_object.radius_m
                    assert math.dist((x, y), (scene.start.x, scene.start.y)) > 0.8
                    assert math.hypot(vx, vy) == pytest.approx(moving_object.speed_mps)
                    assert 0.03 <= moving_object.speed_mps <= 0.06
                world.advance(0.7)


def test_a_moving_object_reverses_at_the_end_of_its_segment():
    moving_object = catalogue.load("corridor", 0).moving_objects[0]
    x, y, vx, vy = moving_object.state(moving_object.reversal_s + 1.0)
    assert (x, y) == pytest.approx(
        (moving_object.end[0] - moving_object.speed_mps, moving_object.end[1])
    )
    assert (vx, vy) == pytest.approx((-moving_object.speed_mps, 0.0))
    assert moving_object.state(2 * moving_object.reversal_s)[:2] == pytest.approx(
        moving_object.start
    )


def test_a_panoramic_scan_sees_two_tags_nearly_everywhere(homes):
    shares = []
    for scene in homes:
        free = space(scene)
        places = free.centres[(free.reachable((scene.start.x, scene.start.y), 0.2)).ravel()][::7]
        plates = [t.parts[0] for t in scene.static_objects if t.name.startswith("tag")]
        spots = [Spot(plate.centre, plate.yaw_rad) for plate in plates]
        shapes = [p for t in scene.static_objects if not t.name.startswith("tag") for p in t.parts]
        shares.append(float((_visible(places, spots, shapes).sum(axis=1) >= 2).mean()))
    assert IN_VIEW_M == 2.5
    assert np.mean(shares) > 0.9
    assert min(shares) > 0.75


def test_landmarks_lie_on_their_plates(homes):
    for scene in homes:
        plates = {t.name: t.parts[0] for t in scene.static_objects if t.name.startswith("tag")}
        for landmark in scene.landmarks:
            plate = plates[f"tag {landmark.identity}"]
            offset = np.array(landmark.position) - np.array(plate.centre)
            front = np.array([math.cos(plate.yaw_rad), math.sin(plate.yaw_rad), 0.0])
            np.testing.assert_allclose(offset, front * plate.size[0] / 2, atol=1e-12)
            assert 0.25 <= landmark.position[2] <= 0.6
