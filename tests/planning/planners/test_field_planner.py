"""The walker of seed 001: via points passed with a heading, obstacles as discs, and no guard."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from mapping.grid.egocentric_grid import EgocentricGrid, GridConfig
from perception.estimate import Estimate
from perception.primitives.errors import ConfigError
from perception.primitives.gaussian import Gaussian
from perception.primitives.obstacle import Obstacle
from planning.planners.field_planner import FieldPlanner
from planning.planners.mission import MissionConfig
from planning.planners.settings import PlanningConfig
from planning.univector.fields import FieldConfig
from planning.world_model import WorldModel

VIAS = [(1.5, 0.0), (1.5, 1.5), (3.0, 1.5)]
FIELD = MissionConfig(planner="field", goals=3)


def planner(mode):
    config = replace(PlanningConfig(), univector=FieldConfig(mode=mode), mission=FIELD)
    config = replace(config, gaze=replace(config.gaze, mode="fixed"))
    return FieldPlanner(config, VIAS)


def world(pose, stamp_s=0.0, obstacles=()):
    estimate = Estimate(stamp_s, Gaussian(np.array(pose), np.eye(3) * 1e-8), obstacles=obstacles)
    return WorldModel(estimate, EgocentricGrid(GridConfig(), np.array(pose[:2])))


def walked(mode, obstacles=(), aside_m=0.0):
    """Poses of a walk through the via points, with exact steps; pushed aside before the first step."""
    walker, pose, stamp = planner(mode), np.zeros(3), 0.0
    walker.decide(world(pose, stamp, obstacles))
    pose[1] = aside_m
    poses = [pose.copy()]
    while not walker.finished(world(pose, stamp)) and stamp < 200.0:
        step = walker.decide(world(pose, stamp, obstacles)).walk
        pose = pose + np.array(
            [
                step.forward_m * math.cos(pose[2]),
                step.forward_m * math.sin(pose[2]),
                step.turn_rad,
            ]
        )
        stamp += 0.65
        poses.append(pose.copy())
    return np.array(poses)


def test_seed_001s_walker_passes_every_via_point_with_the_heading_of_the_line_to_it():
    poses = walked("seed", aside_m=0.8)  # straight to the first one: 28 deg off the line
    lines = zip([(0.0, 0.0), *VIAS], VIAS, strict=False)
    for before, via in lines:
        near = np.hypot(*(poses[:, :2] - via).T) < FIELD.tolerance_m
        k = int(np.argmax(near))  # where the walker turns to the next one
        assert near[k]
        wanted = math.atan2(via[1] - before[1], via[0] - before[0])
        off = (poses[k, 2] - wanted + math.pi) % (2 * math.pi) - math.pi
        assert abs(math.degrees(off)) < 12.0  # one turn of a step is 14 deg


@pytest.mark.parametrize(("mode", "stops"), [("ours", True), ("seed", False)])
def test_only_ours_is_guarded(mode, stops):
    """A wall of posts across the way, one step ahead."""
    posts = tuple(
        Obstacle(
            Gaussian(np.array([0.28, y, 0.0, 0.0]), np.eye(4) * 1e-6), 0.10, 0.4, k, 0.0, 0.0, 0.0
        )
        for k, y in enumerate((-0.3, -0.1, 0.1, 0.3))
    )
    walker = planner(mode)
    decided = [walker.decide(world([0.0, 0.0, 0.0], 0.65 * k, posts)) for k in range(3)]
    assert any(one.why == "guard" for one in decided) == stops


def test_a_standing_obstacle_is_a_disc_that_turns_the_published_walker_aside():
    post = Obstacle(
        Gaussian(np.array([0.8, 0.05, 0.0, 0.0]), np.eye(4) * 1e-6), 0.10, 0.4, 1, 0.0, 0.0, 0.0
    )
    poses = walked("seed", (post,))
    gap = np.hypot(*(poses[:, :2] - [0.8, 0.05]).T).min() - 0.25
    assert 0.0 < gap < 0.6
    assert np.hypot(*(poses[-1, :2] - VIAS[-1])) < FIELD.tolerance_m


def test_the_modes_stand_for_the_corrected_and_the_printed_weights():
    seed, printed = (FieldConfig(mode=mode).as_walked for mode in ("seed", "printed"))
    assert (seed.w_goal, seed.w_avoid) == (0.25, 0.75)
    assert (printed.w_goal, printed.w_avoid) == (0.75, 0.25)
    own = FieldConfig(w_goal=0.4, uncertainty=True)
    assert own.as_walked == own


def test_an_unknown_mode_is_refused():
    with pytest.raises(ConfigError, match="ours, seed, printed"):
        FieldConfig(mode="sed")
