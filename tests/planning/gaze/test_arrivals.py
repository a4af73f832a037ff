"""Looks at directions from which something could have come: doubts in closed form, and turns of the body."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mapping.grid.confidence import ConfidenceLayer
from mapping.grid.egocentric_grid import EgocentricGrid, GridConfig
from perception.primitives.gaussian import Gaussian
from perception.primitives.obstacle import Obstacle
from perception.primitives.pose import Pose2
from planning.gaze.arrivals import EDGE_M, RING, doubts, fastest
from planning.gaze.attention import GazeContext
from planning.gaze.policy import GazeConfig, GazeControl
from planning.gaze.priority import SEEK_MAX
from planning.gaze.selection import GazeMapConfig, in_view

STEP_S, TURN_RAD, WALKS_MPS = 0.65, math.radians(14.0), 0.07


def mover(speed, sigma=0.01, moving=1.0, seen_s=0.0):
    covariance = np.diag([1e-4, 1e-4, sigma**2, sigma**2])
    return Obstacle(
        Gaussian(np.array([9.0, 9.0, speed, 0.0]), covariance), 0.1, moving=moving, seen_s=seen_s
    )


def watched(seconds):
    """A map that was in view all round, some seconds ago."""
    grid = EgocentricGrid(GridConfig(), np.zeros(2))
    layer = ConfidenceLayer(grid)
    layer.see(np.ones_like(layer.values, bool))
    layer.decay(seconds)
    return grid, layer


@pytest.mark.parametrize("yaw", [0.0, 2.0])
def test_the_doubt_is_the_square_of_the_way_that_there_was_time_for(yaw):
    pose = Gaussian(np.array([0.0, 0.0, yaw]), np.eye(3) * 1e-6)
    found = doubts(pose, *watched(6.0), 0.20, WALKS_MPS)
    ahead, behind = int(np.argmax(RING[:, 0])), int(np.argmin(RING[:, 0]))
    assert found[ahead] == pytest.approx(((0.20 + WALKS_MPS) * 6.0 / EDGE_M) ** 2, rel=0.01)
    assert found[behind] == pytest.approx(((0.20 - WALKS_MPS) * 6.0 / EDGE_M) ** 2, rel=0.01)


def test_nothing_comes_from_behind_that_is_not_faster_than_the_robot():
    pose = Gaussian(np.zeros(3), np.eye(3) * 1e-6)
    found = doubts(pose, *watched(20.0), 0.06, WALKS_MPS)
    assert found[np.argmin(RING[:, 0])] == 0.0
    assert found[np.argmax(RING[:, 0])] > 0.5
    assert not doubts(pose, *watched(20.0), 0.0, WALKS_MPS).any()
    assert doubts(pose, *watched(33.0), 1.0, WALKS_MPS).max() == SEEK_MAX


def test_only_obstacles_whose_speed_is_known_teach_how_fast_they_are():
    known = mover(0.12), mover(0.3, sigma=0.1), mover(0.4, moving=0.5)
    assert fastest(0.05, known) == pytest.approx(0.12)
    assert fastest(0.15, known) == pytest.approx(0.15)


class Standing:
    """A robot on its place that turns its body when the gaze asks for it; its map becomes stale out of view."""

    def __init__(self):
        self.policy = GazeControl(GazeConfig())
        self.grid, self.confidence = watched(0.0)
        self.now, self.yaw, self.turns = 0.0, 0.0, 0

    def look(self, obstacles):
        pose = Gaussian(np.array([0.0, 0.0, self.yaw]), np.eye(3) * 1e-6)
        via = 2.0 * np.array([math.cos(self.yaw), math.sin(self.yaw)])
        known = GazeContext(pose, self.grid, self.confidence)
        gaze = self.policy.next(self.now, Pose2(0.0, 0.0, self.yaw), via, obstacles, known)
        self.now += STEP_S
        self.confidence.decay(STEP_S)
        places = self.grid.centres().reshape(-1, 2)
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        body = places @ np.array([[c, -s], [s, c]])
        seen = in_view(
            np.column_stack([body, np.full(len(body), -0.38)]), gaze, GazeMapConfig(across_deg=44.0)
        )
        self.confidence.see(seen.reshape(self.grid.config.cells, -1))
        self.yaw += TURN_RAD * self.policy.turning
        self.turns += abs(self.policy.turning)

    def longest_unseen_s(self):
        """Age of the direction that was out of view for longest."""
        at = np.rint((RING - self.grid.centres()[0, 0]) / self.grid.cell_m).astype(int)
        values = self.confidence.values[at[:, 1], at[:, 0]]
        return float((1.0 - values).max()) / self.confidence.config.loss_per_s


@pytest.mark.parametrize(("speed", "turns"), [(0.05, False), (0.25, True)])
def test_the_body_turns_for_a_look_behind_where_something_faster_was_seen(speed, turns):
    standing = Standing()
    for _ in range(100):
        standing.look([mover(speed, seen_s=standing.now)])
    assert (standing.turns > 0) == turns
    assert (standing.longest_unseen_s() < 30.0) == turns
    assert standing.turns < 60  # most of the time it may walk
