"""What the experiments of seed 000 count: panes, misses, times and errors, against cases whose answer is known."""

from __future__ import annotations

import math
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from perception.monocular.back_projection import project
from perception.monocular.cycle import Monocular, MonocularConfig
from perception.primitives.pose import Pose2
from planning.swarm import random_floors, search
from planning.swarm.objective import ObjectiveConfig
from surefoot.benchmarks import monocular as benchmark
from surefoot.benchmarks.benchmark import Comparison, judge
from surefoot.experiments.joint import four_planners
from surefoot.experiments.seed_000 import monocular_cycle, monocular_time, swarm_table
from surefoot.results.run_folder import RunFolder


@pytest.fixture(scope="module")
def pair():
    return benchmark.scene(np.random.default_rng(5))


def test_a_pane_without_anything_in_it_is_not_counted(pair):
    whole = Monocular(MonocularConfig()).cycle(*pair)
    assert monocular_cycle.shown(whole) == 8
    alone = Monocular(MonocularConfig()).cycle(None, pair[1])
    object.__setattr__(alone, "edges", np.zeros_like(alone.edges))
    assert monocular_cycle.shown(alone) == 7


def test_stages_of_an_earlier_run_are_not_counted(tmp_path, monkeypatch):
    monkeypatch.setattr(monocular_cycle, "FOLDER", tmp_path)
    (tmp_path / "stages-0.png").write_bytes(b"of an earlier run")
    full = SimpleNamespace(
        cvtColor=cv2.cvtColor, COLOR_RGB2BGR=cv2.COLOR_RGB2BGR, imwrite=lambda name, image: False
    )
    monkeypatch.setattr(monocular_cycle, "cv2", full)
    monkeypatch.setattr(monocular_cycle, "CYCLES", 2)
    assert monocular_cycle.run(1, lambda text: None).figures["stages"] == 0.0


def empty_floor(goal):
    floor = random_floors.make(np.random.default_rng(0))
    free = np.ones_like(floor.movable)
    return random_floors.RandomFloor(free, floor.camera, floor.T_body_camera, np.array(goal))


@pytest.mark.parametrize("goal", [(1.5, 0.0), (2.0, 0.6), (1.0, -0.8)])
def test_where_nothing_stands_the_printed_objective_walks_to_the_goal_too(goal):
    """Along the y axis the printed angles are right: nothing is refused, and the nearest pixel wins."""
    floor = empty_floor(goal)
    best = search.exact(swarm_table.printed(floor))
    assert best.value < 0.05
    robot = Pose2(yaw=math.pi / 2)
    place = swarm_table.printed(floor).place(best.pixel)
    np.testing.assert_allclose(robot.inverse().apply(place), goal, atol=0.05)


def test_the_line_of_the_exact_search_tells_what_was_measured():
    gaps = np.array([0.0, 0.0, 0.0, 0.2])
    words = swarm_table._told(gaps, 3.0).split()
    assert [float(words[k]) for k in (0, 3, 4, 6)] == [0.0, 0.2, 25.0, 3.0]


def test_every_step_from_the_picture_to_the_command_is_timed(pair):
    (row,) = monocular_time.timed_cycles([pair])
    deciding = [row[name] for name in monocular_time.DECIDING]
    assert all(spent > 0.0 for spent in deciding)
    seen = sum(row[name] for name in (*monocular_time.STAGES, "colours"))
    assert row["total"] == pytest.approx(seen + sum(deciding))
    assert row["total_swarm"] == pytest.approx(row["total"] - row["search"] + row["swarm"])


def test_computing_is_perceiving_and_deciding_and_nothing_else(tmp_path):
    (tmp_path / "timing.csv").write_text("stamp_s,decide,locate\n0.0,100.0,20.0\n0.65,,30.0\n")
    assert four_planners.computing_s(RunFolder(tmp_path)) == pytest.approx(0.150)
    assert math.isnan(four_planners.computing_s(RunFolder(tmp_path / "none")))


def pixel_of(place, picture):
    return np.rint(project(np.array(place), picture.camera, picture.T_world_camera)).astype(int)


def test_a_speed_is_held_against_the_box_that_has_it(pair):
    """Two boxes with their speeds swapped are two errors, though each speed is somebody's."""
    current = pair[1]
    fronts = [(x, y + v * current.stamp_s) for x, y, v in benchmark.ROBOTS]
    right = [
        (pixel_of(f, current), abs(v))
        for f, (_, _, v) in zip(fronts, benchmark.ROBOTS, strict=True)
    ]
    assert max(map(abs, benchmark.speed_errors(right, current).values())) < 1e-9
    speeds = [0.06, 0.0, 0.06]
    swapped = [(pixel, speed) for (pixel, _), speed in zip(right, speeds, strict=True)]
    errors = list(benchmark.speed_errors(swapped, current).values())
    np.testing.assert_allclose(errors, [0.06, -0.06, 0.0], atol=1e-9)
    missing = benchmark.speed_errors(right[1:], current)
    assert missing[benchmark.ROBOTS[0][1]] == math.inf


def test_a_benchmark_that_is_quick_and_wrong_does_not_pass():
    ratios = {"ratio_opencv": 9.0, "ratio_allowed_error": benchmark.ALLOWED_MPS / 0.06}
    assert not judge(benchmark.BENCHMARK, Comparison({}, ratios))["passed"]


def test_the_gap_of_nothing_found_where_something_is_counts_a_thousand_metres():
    refused = ObjectiveConfig().penalty
    gaps = swarm_table._gaps(np.array([refused, 1.0, refused]), np.array([1.0, 1.0, np.inf]))
    np.testing.assert_allclose(gaps, [1e3, 0.0, 0.0])
