"""Swarm and exact search against a look at every pixel."""

import math

import numpy as np
import pytest

from perception.primitives.camera import Camera
from perception.primitives.errors import ConfigError
from perception.primitives.pose import Pose2, Pose3, head_rotation
from planning.swarm import search
from planning.swarm.objective import PRINTED, Objective, ObjectiveConfig
from planning.swarm.search import SwarmConfig
from surefoot.experiments import random_floors

CAMERA = Camera.from_view(240, 240, math.pi / 2, math.pi / 2)
SEEDS = range(30)


def objective(seed, config=None, pan_deg=0.0, sides=(False, False)):
    rng = np.random.default_rng([seed, 1])
    floor = random_floors.make(rng, CAMERA)
    T = Pose3.from_rotation(
        head_rotation(math.radians(pan_deg), math.radians(30.0)), np.array([0.05, 0.0, 0.383])
    )
    return Objective.of(
        floor.movable, CAMERA, T, Pose2(), floor.goal, config or ObjectiveConfig(), sides
    )


def least(o):
    """The least value over all pixels, by numpy over the public face."""
    v, u = np.mgrid[0 : CAMERA.height, 0 : CAMERA.width]
    value = o.value(np.stack([u.ravel(), v.ravel()], axis=1).astype(float))
    return float(value.min())


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize(("pan", "sides"), [(0.0, (False, False)), (25.0, (False, True))])
def test_the_exact_search_finds_what_a_look_at_every_pixel_finds(seed, pan, sides):
    o = objective(seed, pan_deg=pan, sides=sides)
    found, best = search.exact(o), least(o)
    if best >= o.config.penalty:
        assert found is None
    else:
        assert found is not None
        assert found.value == best
        assert o.value(np.array([found.pixel], float))[0] == best


def test_the_printed_objective_is_searched_exactly_too():
    o = objective(3, PRINTED)
    found = search.exact(o)
    assert found is not None
    assert found.value == least(o)


def test_a_picture_without_floor_has_no_best_pixel():
    T = Pose3.from_rotation(head_rotation(0.0, 0.5), np.array([0.0, 0.0, 0.4]))
    black = np.zeros((240, 240), np.uint8)
    o = Objective.of(black, CAMERA, T, Pose2(), np.array([2.0, 0.0]), ObjectiveConfig())
    assert search.exact(o) is None
    assert search.brute_force(o) is None
    for mode in search.MODES:
        assert search.find(o, SwarmConfig(mode), np.random.default_rng(0)) is None


def gaps(mode):
    found = []
    for seed in SEEDS:
        o = objective(seed)
        best = search.exact(o)
        if best is not None:
            flown = search.fly(o, SwarmConfig(mode), np.random.default_rng(seed))
            found.append(flown.value - best.value)
    return np.array(found)


@pytest.mark.parametrize("mode", ["two_pixel", "constriction", "spread"])
def test_a_stable_swarm_is_near_the_optimum_and_never_beyond(mode):
    gap = gaps(mode)
    assert gap.min() >= 0.0
    assert np.quantile(gap, 0.85) <= 0.05


def test_the_printed_inertia_misses_most_of_the_time():
    assert np.mean(gaps("literal") > 0.05) > 0.6


def test_the_printed_inertia_throws_the_swarm_to_the_rim():
    """Mean dynamics x'' of w = 2, c1 + c2 = 4 have spectral radius 1.41, of constriction 0.85."""
    radius = {}
    for mode, (inertia, own, others, _) in search.MODES.items():
        pull = (own + others) / 2
        step = np.array([[1 + inertia - pull, -inertia], [1.0, 0.0]])
        radius[mode] = max(abs(np.linalg.eigvals(step)))
    assert radius["literal"] == pytest.approx(math.sqrt(2.0), abs=1e-6)
    assert radius["constriction"] < 0.9


def test_chance_is_an_argument():
    o = objective(1)
    first, again = (search.fly(o, SwarmConfig("spread"), np.random.default_rng(4)) for _ in "ab")
    assert first == again


def test_the_chosen_pixel_is_never_a_forbidden_one():
    for seed in SEEDS:
        o = objective(seed)
        for mode in ("exact", "spread", "literal"):
            found = search.find(o, SwarmConfig(mode), np.random.default_rng(seed))
            if found is not None:
                assert o.value(np.array([found.pixel], float))[0] < o.config.penalty


def test_an_unknown_mode_names_the_known_ones():
    with pytest.raises(ConfigError, match="'best' is unknown; choose exact, literal"):
        SwarmConfig("best")
