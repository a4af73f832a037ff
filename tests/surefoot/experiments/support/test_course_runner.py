"""Courses by geometric perception: short walks, step filters, falls, and the classes of contacts."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from planning.commands import WalkCommand
from planning.safety.guard import Guard
from planning.safety.line_of_sight import is_blocked
from planning.safety.step_filter import Unfiltered
from sim.scenes import catalogue
from surefoot.config.presets import on_body
from surefoot.evaluation.metrics.contacts import Touch
from surefoot.experiments.joint import gaze_coupling
from surefoot.experiments.seed_001.course_trials import HEADER, figures, row
from surefoot.experiments.support.course_runner import CourseWalk, course_config, walk


def short(scene, seed, seconds):
    config = course_config(scene, seed)
    return replace(config, mission=replace(config.mission, time_limit_s=seconds))


@pytest.mark.parametrize("perfect", [True, False])
def test_twenty_seconds_among_fast_obstacles_have_no_contact(perfect):
    result = walk(short("fast_course", 0, 20.0), perfect)
    assert result.contacts == []
    assert result.clearance_m > 0.0
    (_, x0, y0, _), (_, x1, y1, _) = result.trace[0], result.trace[-1]
    assert math.hypot(x1 - x0, y1 - y0) > 0.4


class Recording(Unfiltered):
    """Makes every desired step and records the arguments of the step filter."""

    def __init__(self):
        self.heard = []

    def choose(self, desired, robot, obstacles, occupied, target, stamp_s, unseen=None):
        self.heard.append((robot.mean[:2], occupied, target))
        return super().choose(desired, robot, obstacles, occupied, target, stamp_s)


def test_steps_are_filtered_towards_the_goal_if_only_moving_obstacles_are_in_the_path():
    """A moving obstacle bends the path, but its waypoint moves with the obstacle and is no target."""
    config, stepper = short("fast_course", 2, 40.0), Recording()
    goal = np.array(catalogue.load("fast_course", 2, config.difficulty).goals[0])
    walk(config, True, stepper)
    clear = [
        target
        for here, standing, target in stepper.heard
        if not is_blocked(
            here, goal, standing, Guard(config.guard, config.robot_model).cell_distance_m
        )
    ]
    assert len(clear) > 20
    np.testing.assert_allclose(clear, np.broadcast_to(goal, (len(clear), 2)), atol=1e-9)


def test_the_same_seed_gives_the_same_trajectory():
    one, two = (walk(short("course", 1, 10.0)) for _ in range(2))
    assert one.trace == two.trace


def test_the_pose_is_that_of_the_localiser_and_the_start_is_not_known_exactly():
    """Errors of millimetres that tags keep small; error-free perception knows the true pose."""
    errors = np.abs([e[:2] for e in walk(short("course", 1, 20.0)).pose_errors])
    assert errors[0].max() > 1e-3
    assert 5e-4 < np.median(errors[-15:]) < 0.02
    assert np.max(walk(short("course", 1, 5.0), True).pose_errors) < 1e-9


def on_steep_slope(config):
    """The dynamic body on a slope of eleven degrees, where it falls."""
    config = on_body(config, "dynamic")
    dynamic = replace(config.robot.dynamic, slope_rad=(0.2, 0.0))
    return replace(config, robot=replace(config.robot, dynamic=dynamic))


def test_a_fall_ends_the_walk_and_is_counted():
    result = walk(on_steep_slope(short("course", 0, 60.0)), True)
    assert result.fell
    assert not result.arrived
    assert result.time_s < 30.0
    stood = CourseWalk(time_s=9.0, cycle_ms=[1.0], decision_ms=[1.0], pose_errors=[(0.0, 0.0, 0.0)])
    assert figures([result, stood])["falls"] == 1.0
    assert row("x", [result, stood])[: HEADER.index("falls") + len("falls")].endswith("  1")


def test_a_fall_ends_a_walk_of_the_gaze_experiment(monkeypatch):
    monkeypatch.setattr(
        gaze_coupling,
        "course_config",
        lambda scene, seed: on_steep_slope(course_config(scene, seed)),
    )
    looked = gaze_coupling.walk_with_gaze(0, "fixed", "dynamic")
    assert looked.fell
    assert not looked.arrived
    assert looked.time_s < 60.0


def test_a_given_step_filter_replaces_the_guard():
    result = walk(short("course", 2, 10.0), True, Unfiltered())
    assert result.guarded == 0


def test_a_contact_counts_once_until_there_is_a_gap():
    touch = Touch()
    gaps = [{3: 0.01}, {3: -0.01}, {3: -0.02}, {3: 0.01}, {3: -0.01}, {3: 0.03}, {3: -0.01}]
    assert [touch.begun(gap, 0.02) for gap in gaps] == [[], [3], [], [], [], [], [3]]


def test_a_robot_that_only_turns_counts_as_standing():
    touch = Touch()
    touch.step(WalkCommand(turn_rad=0.2))
    assert touch.standing
    touch.step(WalkCommand(lateral_m=0.01))
    assert not touch.standing
