"""Office and hall: enough obstacles, and every goal reachable."""

from __future__ import annotations

import math

import numpy as np
import pytest

from perception.primitives.errors import SurefootError
from sim.free_space import clearance_map
from sim.scenes import catalogue, public_places
from sim.shapes import distance


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("name", ["office", "hall"])
def test_every_goal_is_reachable(name, seed):
    scene = catalogue.load(name, seed)
    space = clearance_map(scene.extent, [p for t in scene.obstacles for p in t.parts])
    reach = space.reachable((scene.start.x, scene.start.y), 0.28)
    assert all(reach[space.cell(goal)] for goal in scene.goals)
    assert len(scene.landmarks) >= 16


def test_an_office_is_cluttered():
    names = [item.name.split()[0] for item in catalogue.load("office", 1).obstacles]
    assert names.count("desk") == 6
    assert names.count("chair") == 6
    assert names.count("bin") == 3


@pytest.mark.parametrize("seed", range(30))
def test_a_hall_has_all_its_people(seed):
    scene = catalogue.load("hall", seed)
    assert [moving_object.name for moving_object in scene.moving_objects] == [
        f"person {k}" for k in range(1, 6)
    ]


def test_a_hall_without_room_for_its_people_is_refused(monkeypatch):
    monkeypatch.setattr(public_places, "DRAWS", 10)
    crowd = (2, 12, 14)  # twelve people 0.6 m apart do not fit into 5.2 m
    monkeypatch.setattr(public_places, "PEOPLE", crowd)
    with pytest.raises(SurefootError, match=r"hall: .* seed 3 .* people"):
        catalogue.load("hall", 3)


@pytest.mark.parametrize("seed", range(4))
def test_people_cross_the_hall_without_contact(seed):
    scene = catalogue.load("hall", seed)
    times = np.linspace(0.0, 200.0, 81)
    ways = [
        np.array([moving_object.state(t)[:2] for t in times])
        for moving_object in scene.moving_objects
    ]
    for k, way in enumerate(ways):
        assert np.ptp(way[:, 1]) > 3.0
        for item in scene.static_objects:
            for part in item.parts:
                if part.bottom_m < 1.6:
                    assert distance(part, way).min() > scene.moving_objects[k].radius_m
        for other in ways[:k]:
            assert min(math.dist(a, b) for a in way for b in other) > 0.4
