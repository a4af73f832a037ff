"""Movers by their laws: free space, no passing through each other, and the same bits for the same seed."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from perception.primitives.errors import ConfigError
from perception.primitives.pose import Pose2
from sim.movers.law import LAWS, MIXED, MoversConfig
from sim.movers.population import populated
from sim.movers.traffic import ROBOT_RADIUS_M, Traffic
from sim.scene import TO_AND_FRO, FloorArea, MovingObject, Scene
from sim.scenes import catalogue
from sim.shapes import Cylinder, distance
from sim.world import World

OTHERS = tuple(name for name in LAWS if name != TO_AND_FRO)


@cache
def scene(name, law, legs=False):
    return catalogue.load(name, 3, movers=MoversConfig(law, legs))


def walked(one, seconds=100.0, every_s=0.5, seed=0, robot=None):
    """States [time, mover, (x, y, vx, vy)]."""
    traffic = Traffic(one, seed)
    found = []
    for k in range(int(seconds / every_s)):
        traffic.advance_to(k * every_s, robot)
        found.append(traffic.states(k * every_s))
    return np.array(found)


@cache
def walked_in(name, law):
    return walked(scene(name, law), 24.0)


def room(*movers):
    """An empty room of 6 x 6 m."""
    extent = (-3.0, -3.0, 3.0, 3.0)
    area = (FloorArea("planks/oak", extent),)
    return Scene("test", 0, extent, area, (), movers, (), Pose2(-2.5, -2.5), ())


def mover(law, start=(0.0, 0.0), speed=0.1, length=2.0, heading=0.0):
    body = Cylinder((0.0, 0.0, 0.2), 0.1, 0.4)
    return MovingObject("one", start, heading, speed, length / speed, (body,), 0.6, 0.0, law)


def test_movers_go_to_and_fro_in_closed_form_unless_another_law_is_chosen():
    one = catalogue.load("home", 5)
    rng = np.random.default_rng([7, 20])
    phases = [float(rng.uniform(0.0, 2.0 * m.reversal_s)) for m in one.moving_objects]
    with World(one, "tiny", 7) as world:
        for stamp in (0.0, 0.65, 33.3, 33.3):
            world.advance_to(stamp)
            wanted = [m.state(p + stamp) for m, p in zip(one.moving_objects, phases, strict=True)]
            assert world.moving_states() == wanted


@pytest.mark.parametrize(
    ("name", "law"), [*(("home", law) for law in OTHERS), ("hall", MIXED), ("office", MIXED)]
)
def test_movers_touch_neither_furniture_nor_each_other(name, law):
    one = scene(name, law)
    states = walked_in(name, law)
    radii = [m.radius_m for m in one.moving_objects]
    for k, who in enumerate(one.moving_objects):
        places = states[:, k, :2]
        for item, shape in one.static_shapes:
            if shape.bottom_m < who.height_m:
                assert distance(shape, places).min() > radii[k] - 0.01, item
        for j in range(k):
            apart = np.hypot(*(places - states[:, j, :2]).T)
            assert apart.min() > radii[k] + radii[j]


@pytest.mark.parametrize("law", OTHERS)
def test_a_velocity_is_the_rate_of_change_of_the_place(law):
    traffic = Traffic(scene("home", law), 0)
    for stamp in np.arange(1.0, 8.0, 0.73):
        traffic.advance_to(stamp)
        before = np.array(traffic.states(stamp))
        after = np.array(traffic.states(stamp + 1e-6))
        within = (stamp / 0.1) % 1.0 < 0.99
        if within:
            np.testing.assert_allclose((after - before)[:, :2] / 1e-6, before[:, 2:], atol=1e-5)


@pytest.mark.parametrize("law", [*OTHERS, MIXED])
def test_the_same_seed_gives_the_same_bits_however_the_clock_advances(law):
    one, fine = scene("home", law), walked_in("home", law)
    assert (fine[:18:6] == walked(one, 9.0, 3.0)).all()
    assert not (walked(one, 3.0, 3.0, seed=1) == fine[:1]).all()


@pytest.mark.parametrize("law", [law for law in OTHERS if law != "standing"])
def test_speeds_are_those_of_small_robots(law):
    speed = np.hypot(*np.moveaxis(walked_in("home", law)[:, :, 2:], -1, 0))
    assert speed.max() <= 1.3 * 0.15 + 1e-9
    assert speed.max() >= 0.03 * 0.7


def test_who_stops_and_goes_does_both_on_its_line():
    states = walked(room(mover("stop_and_go")), 200.0)[:, 0]
    still = np.hypot(states[:, 2], states[:, 3]) == 0.0
    assert 0.2 < still.mean() < 0.7
    np.testing.assert_allclose(states[:, 1], 0.0, atol=1e-9)


def test_who_stands_walks_after_a_minute():
    states = walked(room(mover("standing")), 100.0)[:, 0]
    away = np.hypot(*(states[:, :2] - states[0, :2]).T)
    assert away[: int(40 / 0.5)].max() == 0.0
    assert away.max() > 0.5


def test_a_curve_is_smooth():
    states = walked(room(mover("curves")), 60.0, 0.1)[:, 0]
    heading = np.unwrap(np.arctan2(states[:, 3], states[:, 2]))
    assert np.abs(np.diff(heading)).max() < 0.15
    assert np.ptp(heading) > 0.5
    np.testing.assert_allclose(np.hypot(states[:, 2], states[:, 3]), 0.1, atol=1e-9)


def test_a_follower_walks_where_its_leader_walked():
    two = (mover("follower"), mover("follower", start=(-0.6, 0.0)))
    states = walked(room(*two), 120.0, 0.1)
    path = states[:, 0, :2]
    late = states[400:, 1, :2]
    off = [np.hypot(*(path - place).T).min() for place in late]
    assert max(off) < 0.25
    assert np.hypot(*(states[400:, 0, :2] - late).T).max() < 1.2


def test_a_group_stays_together():
    three = tuple(mover("group", start=(0.5 * k, 0.0)) for k in range(3))
    states = walked(room(*three), 100.0)
    spread = np.linalg.norm(states[:, :, None, :2] - states[:, None, :, :2], axis=-1)
    assert np.quantile(spread[80:].max(axis=(1, 2)), 0.9) < 1.5


def test_streams_go_from_side_to_side_across_each_other():
    two = (mover("stream"), mover("stream", start=(1.0, 1.0)))
    states = walked(room(*two), 150.0)
    for k in range(2):
        along = states[:, k, k]
        assert along.max() > 1.5
        assert along.min() < -1.5


@pytest.mark.parametrize(
    ("law", "keeps_off"), [("social_force_reacting", True), ("social_force", False)]
)
def test_only_a_pedestrian_that_reacts_keeps_off_the_robot(law, keeps_off):
    least = []
    for seed in range(2):
        free = walked(room(mover(law)), 40.0, seed=seed)[:, 0, :2]
        middle = free[len(free) // 2]  # the robot stands where the pedestrian would walk
        states = walked(room(mover(law)), 40.0, seed=seed, robot=tuple(middle))[:, 0]
        least.append(np.hypot(*(states[:, :2] - middle).T).min() - ROBOT_RADIUS_M - 0.1)
    assert (min(least) > 0.0) == keeps_off


def test_laws_vary_sizes_and_speeds_by_the_seed():
    first, second = (catalogue.load("hall", seed, movers=MoversConfig("curves")) for seed in (0, 1))
    for what in ("radius_m", "height_m", "speed_mps"):
        assert len({getattr(m, what) for m in (*first.moving_objects, *second.moving_objects)}) > 5


def test_the_defaults_change_no_scene():
    one = catalogue.load("flat", 0)
    assert populated(one, MoversConfig()) is one


def test_a_scene_without_movers_gets_some_for_a_law():
    assert catalogue.load("office", 0).moving_objects == ()
    assert len(scene("office", "waypoints").moving_objects) == 3


def test_mixed_laws_differ_within_a_scene():
    assert len({m.law for m in scene("hall", MIXED).moving_objects}) > 2


def test_an_unknown_law_is_refused_with_the_known_ones():
    with pytest.raises(ConfigError, match=r"law='zigzag' is unknown; choose to_and_fro.*mixed"):
        MoversConfig("zigzag")


def test_one_foot_stands_while_the_other_overtakes_it():
    (one,) = room(replace(mover(TO_AND_FRO), legs=None)).moving_objects
    person = next(m for m in scene("hall", TO_AND_FRO, legs=True).moving_objects)
    walker = room(replace(one, legs=person.legs, parts=person.parts))
    traffic = Traffic(walker, 0)
    feet = np.array([traffic.body_states(s)[1:] for s in np.arange(0.0, 15.0, 0.05)])
    stands = np.hypot(feet[..., 2], feet[..., 3]) == 0.0
    assert (stands.sum(axis=1) == 1).all()
    trunk = np.array([traffic.states(s)[0] for s in np.arange(0.0, 15.0, 0.05)])
    out = np.hypot(*np.moveaxis(feet[..., :2] - trunk[:, None, :2], -1, 0)) + person.legs.radius
    assert out.max() <= person.radius_m + 1e-9
    moved = np.diff(feet[..., :2], axis=0)
    both = stands[1:] & stands[:-1]
    assert np.abs(moved[both]).max() < 1e-9


def test_legs_are_seen_apart_where_a_trunk_would_be_one_thing():
    one = scene("hall", TO_AND_FRO, legs=True)
    with World(one, "tiny", 0) as world:
        left, right = world.body_states()[1:3]
        middle = (left[0] + right[0]) / 2, (left[1] + right[1]) / 2
        legs = one.moving_objects[0].legs
        assert math.dist(left[:2], right[:2]) > 2.0 * legs.radius
        down = np.array([[0.0, 0.0, -1.0]], np.float32)
        between = world.rays.cast(np.array([*middle, 0.5]), down)
        onto = world.rays.cast(np.array([*left[:2], 0.7499]), -down)
        assert between.distance_m[0] == pytest.approx(0.5, abs=1e-3)  # the floor
        assert onto.distance_m[0] < 0.01  # the leg's top or the trunk


def test_fast_movers_do_not_pass_through_each_other_between_two_ticks():
    """One that goes along x meets one that stands: 0.5 m in a tick, both are 0.2 m wide."""
    runner = mover("stop_and_go", (-2.0, 0.0), 5.0, 4.0)
    stands = replace(mover("standing", (0.25, 0.0), 5.0, 0.1), name="other")
    states = walked(room(runner, stands), 12.0, 0.05)
    apart = np.hypot(*(states[:, 0, :2] - states[:, 1, :2]).T)
    assert apart.min() > 0.2
    assert np.ptp(states[:, 0, 0]) > 1.0  # it did run


def test_a_room_is_given_no_more_movers_than_it_has_room_for():
    extent = (0.0, 0.0, 1.2, 1.2)
    area = (FloorArea("planks/oak", extent),)
    small = Scene("test", 0, extent, area, (), (), (), Pose2(0.3, 0.6), ((0.9, 0.6),))
    movers = populated(small, MoversConfig("waypoints")).moving_objects
    for k, one in enumerate(movers):
        for other in movers[:k]:
            assert math.dist(one.start, other.start) > one.radius_m + other.radius_m
    assert len(populated(room(), MoversConfig("waypoints")).moving_objects) == 3
