"""The environments of seed 000 against the printed figures."""

import math

import numpy as np
import pytest

from sim.scenes import catalogue
from sim.scenes.scene_file import EXAMPLE, read_scene
from sim.scenes.seed_rooms import COURSE_M, GATES, GOAL_TIMES_S
from sim.world import World

SLANT = 0.06 / math.sqrt(2.0)
PRINTED = {  # closed form at 0.06 m/s: positions of d1, d2 and d3, and their direction
    0.0: ((0.6, 1.1, 1), (0.0, 0.7, 1), (-0.2, 3.3, 1)),
    10.0: ((0.0, 1.1, 1), (0.0, 1.3, 1), (-0.2 + 10 * SLANT, 3.3 + 10 * SLANT, 1)),
    20.0: ((-0.6, 1.1, 1), (0.0, 1.66, -1), (-0.2 + 16 * SLANT, 3.3 + 16 * SLANT, -1)),
    30.0: ((-0.6, 1.1, -1), (0.0, 1.06, -1), (-0.2 + 6 * SLANT, 3.3 + 6 * SLANT, -1)),
    50.0: ((0.6, 1.1, 1), (0.0, 1.54, 1), (-0.2 + 14 * SLANT, 3.3 + 14 * SLANT, 1)),
}


@pytest.mark.parametrize("seed", [0, 7])
def test_robots_of_the_printed_room_move_as_printed(seed):
    with World(catalogue.load("printed_room", seed), "tiny", seed) as world:
        for stamp_s, robots in PRINTED.items():
            world.advance_to(stamp_s)
            for state, (x, y, sense), heading in zip(
                world.moving_states(), robots, (math.pi, math.pi / 2, math.pi / 4), strict=True
            ):
                speed = 0.06 * sense
                moving = (speed * math.cos(heading), speed * math.sin(heading))
                assert state == pytest.approx((x, y, *moving), abs=1e-9)


def test_the_robots_room_is_the_same_with_random_phases():
    printed, usual = catalogue.load("printed_room", 3), catalogue.load("robots_room", 3)
    assert printed.static_objects == usual.static_objects
    assert printed.goals == usual.goals == ((0, 4), (-1, -0.2), (1, 0.1), (-1, 4), (1, 0))
    assert GOAL_TIMES_S["robots_room"] == (0.0, 70.0, 130.0, 150.0, 200.0)
    with World(usual, "tiny", 3) as world:
        assert world.moving_states()[0][:2] != pytest.approx((0.6, 1.1))


def test_the_path_through_the_gates_has_the_printed_length():
    scene = catalogue.load("narrow_course", 0)
    sides = [1.3 - y if scene.start.y != pytest.approx(0.65) else y for _, y in GATES]
    way = [(scene.start.x, scene.start.y), *zip([x for x, _ in GATES], sides, strict=True)]
    way.append(scene.goals[-1])
    assert np.hypot(*np.diff(np.array(way), axis=0).T).sum() == pytest.approx(COURSE_M)


def test_a_user_can_set_the_phase_of_a_moving_object(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(EXAMPLE.replace("speed = 0.05", "speed = 0.05\nphase = 10.0"))
    with World(read_scene(path, 4), "tiny", 4) as world:
        assert world.moving_states()[0][:2] == pytest.approx((3.6, 1.5))
