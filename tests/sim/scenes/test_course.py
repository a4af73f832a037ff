"""The courses: positions, segments and lengths are within their limits for any seed."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sim.scenes import catalogue, course

KINDS = [course.SLOW, course.FAST, course.HARD]


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
@pytest.mark.parametrize("seed", [0, 7, 91])
def test_a_course_has_its_obstacles_length_and_passages(kind, seed):
    scene = catalogue.load(kind.name, seed)
    posts = np.array([item.parts[0].centre[:2] for item in scene.obstacles])
    assert len(posts) == kind.standing
    assert len(scene.moving_objects) == kind.moving
    way = np.array([[scene.start.x, scene.start.y], *scene.goals])
    assert np.hypot(*np.diff(way, axis=0).T).sum() == pytest.approx(30.0, abs=1e-9)
    apart = np.linalg.norm(posts[:, None] - posts[None], axis=-1) + 9.0 * np.eye(len(posts))
    assert apart.min() >= kind.between_m - 2e-3
    assert np.linalg.norm(posts[:, None] - way[None, 1:], axis=-1).min() >= 0.45 - 2e-3
    for moving_object in scene.moving_objects:
        assert kind.speeds_mps[0] <= moving_object.speed_mps <= kind.speeds_mps[1]
        line = np.array(
            [moving_object.state(s)[:2] for s in np.linspace(0.0, moving_object.reversal_s, 60)]
        )
        assert np.linalg.norm(line[:, None] - posts[None], axis=-1).min() >= 0.28
        assert line.min() >= 0.3 - 1e-9
        assert line.max() <= kind.side_m - 0.3 + 1e-9
        assert min(math.dist(p, (scene.start.x, scene.start.y)) for p in line) >= 0.58


def test_the_same_seed_gives_the_same_course_and_another_seed_another():
    assert catalogue.load("course", 5) == catalogue.load("course", 5)
    assert catalogue.load("course", 5).goals != catalogue.load("course", 6).goals
