"""Counts, gaps, times and errors of the experiments of Han 2018, on cases with a known answer."""

from __future__ import annotations

import math

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


def test_an_empty_pane_is_not_counted(pair):
    complete = Monocular(MonocularConfig()).cycle(*pair)
    assert monocular_cycle.panes_with_content(complete) == 8
    single = Monocular(MonocularConfig()).cycle(None, pair[1])
    object.__setattr__(single, "edges", np.zeros_like(single.edges))
    assert monocular_cycle.panes_with_content(single) == 7


def empty_floor(goal):
    floor = random_floors.make(np.random.default_rng(0))
    free = np.ones_like(floor.movable)
    return random_floors.RandomFloor(free, floor.camera, floor.T_body_camera, np.array(goal))


@pytest.mark.parametrize("goal", [(1.5, 0.0), (2.0, 0.6), (1.0, -0.8)])
def test_without_obstacles_the_printed_objective_selects_the_goal(goal):
    """Along the y axis the printed angles are correct: no pixel is forbidden, and the nearest one is selected."""
    floor = empty_floor(goal)
    best = search.exact(swarm_table.printed(floor))
    assert best.value < 0.05
    robot = Pose2(yaw=math.pi / 2)
    place = swarm_table.printed(floor).place(best.pixel)
    np.testing.assert_allclose(robot.inverse().apply(place), goal, atol=0.05)


def test_the_row_of_the_exact_search_shows_the_measured_gaps():
    gaps = np.array([0.0, 0.0, 0.0, 0.2])
    words = swarm_table._measured_columns(gaps, 3.0).split()
    assert [float(words[k]) for k in (0, 3, 4, 6)] == [0.0, 0.2, 25.0, 3.0]


def test_every_stage_from_the_image_to_the_command_is_timed(pair):
    (row,) = monocular_time.timed_cycles([pair])
    deciding = [row[name] for name in monocular_time.DECIDING]
    assert all(spent > 0.0 for spent in deciding)
    seen = sum(row[name] for name in (*monocular_time.STAGES, "colours"))
    assert row["total"] == pytest.approx(seen + sum(deciding))
    assert row["total_swarm"] == pytest.approx(row["total"] - row["search"] + row["swarm"])


def test_computing_time_is_the_sum_of_the_timed_stages(tmp_path):
    (tmp_path / "timing.csv").write_text("stamp_s,decide,locate\n0.0,100.0,20.0\n0.65,,30.0\n")
    assert four_planners.computing_s(RunFolder(tmp_path)) == pytest.approx(0.150)
    assert math.isnan(four_planners.computing_s(RunFolder(tmp_path / "none")))


def pixel_of(place, picture):
    return np.rint(project(np.array(place), picture.camera, picture.T_world_camera)).astype(int)


def test_a_speed_is_compared_with_that_of_its_own_box(pair):
    """Swapping the speeds of two boxes gives two errors."""
    current = pair[1]
    fronts = [(x, y + v * current.stamp_s) for x, y, v in benchmark.ROBOTS]
    correct = [
        (pixel_of(f, current), abs(v))
        for f, (_, _, v) in zip(fronts, benchmark.ROBOTS, strict=True)
    ]
    assert max(map(abs, benchmark.speed_errors(correct, current).values())) < 1e-9
    speeds = [0.06, 0.0, 0.06]
    swapped = [(pixel, speed) for (pixel, _), speed in zip(correct, speeds, strict=True)]
    errors = list(benchmark.speed_errors(swapped, current).values())
    np.testing.assert_allclose(errors, [0.06, -0.06, 0.0], atol=1e-9)
    missing = benchmark.speed_errors(correct[1:], current)
    assert missing[benchmark.ROBOTS[0][1]] == math.inf


def test_a_fast_but_inaccurate_benchmark_does_not_pass():
    ratios = {"ratio_opencv": 9.0, "ratio_allowed_error": benchmark.ALLOWED_MPS / 0.06}
    assert not judge(benchmark.BENCHMARK, Comparison({}, ratios))["passed"]


def test_a_missed_optimum_counts_as_a_gap_of_a_thousand_metres():
    refused = ObjectiveConfig().penalty
    gaps = swarm_table._gaps(np.array([refused, 1.0, refused]), np.array([1.0, 1.0, np.inf]))
    np.testing.assert_allclose(gaps, [1e3, 0.0, 0.0])
