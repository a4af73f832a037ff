"""A walk that does not arrive says why."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from sim.robot_config import RobotConfig
from surefoot.config.schema import Config
from surefoot.results.run_folder import RunFolder
from surefoot.run.simulate import simulate
from surefoot.run.summary import Decided, why_unfinished


def decided(*parts: tuple[int, str]) -> list[Decided]:
    """One decision a second, 10 mm apart, so many of each kind."""
    words = [why for count, why in parts for _ in range(count)]
    return [Decided(float(k), why, (0.01 * k, 0.0)) for k, why in enumerate(words)]


@pytest.mark.parametrize(
    ("word", "limit_s", "reason"),
    [
        ("blocked", 100.0, "stopped at the time limit of 100 s"),
        ("unknown", 300.0, "stopped where no step led on: unknown"),
        ("walk", 300.0, "ended by its planner"),
    ],
)
def test_the_reason_and_the_decisions_of_the_last_minute_are_told(word, limit_s, reason):
    walk = decided((60, "guard"), (10, "survey"), (30, word))
    said = why_unfinished(walk, 100.0, limit_s, 1.234)
    assert said == (
        reason,
        f"1.23 m from the goal; the last 60 s, within 0.58 m: {word} x30; guard x19; survey x10",
    )


def test_a_walk_that_ends_before_its_first_decision_has_none():
    assert why_unfinished([], 0.5, 0.5, 2.0)[1].endswith("the last 0 s, within 0.00 m: none")


def test_a_walk_out_of_time_says_so_and_how_far_it_was(tmp_path):
    robot = RobotConfig(colour=False, stereo=False, tof_source="rays")
    config = Config(scene="boxes", seed=3, robot=robot)
    config = replace(config, mission=replace(config.mission, time_limit_s=5.0))
    summary = simulate(config, tmp_path / "run", False, lambda line: None, report=False)
    run = RunFolder.open(summary.folder)
    told = run.read_json("summary.json")
    goal = np.array(told["goal_positions"][0])
    left_m = np.linalg.norm(goal - run.read_trajectory("truth/trajectory.txt").positions[-1, :2])
    assert summary.notes[0] == "stopped at the time limit of 5 s"
    assert abs(float(summary.notes[1].split()[0]) - left_m) < 0.1  # error of the pose
    assert told["notes"][:2] == list(summary.notes[:2])
    assert (summary.notes[0], summary.notes[1]) in pairwise(summary.lines())
