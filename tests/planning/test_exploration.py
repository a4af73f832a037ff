"""Exploration of random flats: it sees all reachable ground and gives up unreachable targets."""

from __future__ import annotations

import math
import time

import numpy as np
import pytest
from scipy import ndimage
from scipy.sparse import csgraph

from perception.primitives.errors import ConfigError
from planning.exploration import ExplorationConfig, ExplorationMap, Explorer, _Paths

CELL = 0.05


def flat() -> np.ndarray:
    """Two rooms with a door, 4 x 3 m; True is wall or furniture."""
    occupied = np.zeros((60, 80), dtype=bool)
    occupied[[0, -1], :] = occupied[:, [0, -1]] = True
    occupied[:, 39:41] = True
    occupied[24:38, 39:41] = False  # the door, 0.7 m
    occupied[10:20, 10:22] = True
    occupied[40:50, 60:66] = True
    return occupied


class Walk:
    """A body that goes straight to its goal, 0.1 m at a time, and sees 1.5 m far through nothing."""

    def __init__(self, occupied: np.ndarray, here: tuple[float, float]) -> None:
        self.occupied, self.here = occupied, np.array(here)
        self.known = np.zeros_like(occupied)
        self.updated_s = np.zeros(occupied.shape)
        self.t = 0.0
        self.look()

    def ground(self) -> ExplorationMap:
        return ExplorationMap(
            self.occupied & self.known, self.known.copy(), self.updated_s.copy(), np.zeros(2), CELL
        )

    def look(self) -> None:
        angles = np.linspace(0, 2 * math.pi, 240, endpoint=False)
        r = np.arange(0.0, 1.5, CELL / 2)
        rays = r[:, None] * np.stack([np.cos(angles), np.sin(angles)])[:, None]
        cells = ((self.here[:, None, None] + rays) / CELL).astype(int)
        rows, columns = (  # rays end at the outer walls
            np.clip(cells[axis], 0, n - 1) for axis, n in zip((1, 0), self.known.shape, strict=True)
        )
        hit = self.occupied[rows, columns]
        seen = np.cumsum(hit, axis=0) - hit == 0  # up to the first occupied cell
        self.known[rows[seen], columns[seen]] = True
        self.updated_s[rows[seen], columns[seen]] = self.t

    def step(self, goal: np.ndarray) -> None:
        away = goal - self.here
        distance = float(np.hypot(*away))
        if distance > 1e-9:
            self.here = self.here + away * min(1.0, 0.1 / distance)
        self.t += 1.0


def test_all_reachable_ground_is_seen_without_entering_obstacles():
    walk = Walk(flat(), (0.5, 2.0))
    explorer = Explorer(ExplorationConfig(ahead_m=0.15))  # without a local planner here
    for _ in range(400):
        walk.step(explorer.goal(walk.ground(), walk.here, walk.t))
        walk.look()
        cell = int(walk.here[1] / CELL), int(walk.here[0] / CELL)
        assert not walk.occupied[cell]
    labels, _ = ndimage.label(~walk.occupied)
    within = labels == labels[40, 10]
    assert np.mean(walk.known[within]) > 0.97
    assert explorer.visited >= 2


def test_with_all_seen_the_ground_seen_longest_ago_is_visited():
    walk, explorer = Walk(flat(), (0.5, 2.0)), Explorer()
    walk.known[:] = True
    walk.updated_s[:] = 50.0
    walk.updated_s[4:20, 60:76] = 1.0  # a corner of the other room
    walk.t = 60.0
    for _ in range(80):
        walk.step(explorer.goal(walk.ground(), walk.here, walk.t))
        if explorer.visited:
            break
    assert np.all(np.abs(walk.here - [3.4, 0.6]) < 0.75)


def test_a_target_that_is_never_reached_is_given_up():
    walk, explorer = Walk(flat(), (0.5, 2.0)), Explorer()
    first = explorer.goal(walk.ground(), walk.here, 0.0)
    goals = [explorer.goal(walk.ground(), walk.here, float(t)) for t in range(1, 100)]
    assert np.array_equal(goals[20], first)  # patient at first
    assert any(float(np.hypot(*(goal - first))) > 0.3 for goal in goals)


def test_paths_are_as_short_as_those_of_bellman_ford():
    rng = np.random.default_rng(3)
    occupied = ndimage.binary_dilation(rng.random((40, 50)) < 0.02, iterations=2)
    occupied[18:23, 18:23] = False
    ground = ExplorationMap(
        occupied, ~np.zeros_like(occupied), np.zeros(occupied.shape), np.zeros(2), CELL
    )
    here = np.array([20.5, 20.5]) * CELL
    paths = _Paths(ground, here, 0.06)
    free = np.isfinite(paths.metres)
    nodes = np.argwhere(free)
    apart = np.abs(nodes[:, None] - nodes[None]).max(axis=-1)
    edges = np.where(apart == 1, np.linalg.norm(nodes[:, None] - nodes[None], axis=-1) * CELL, 0.0)
    start = int(np.flatnonzero((nodes == [20, 20]).all(axis=1))[0])
    expected = csgraph.bellman_ford(edges, indices=start)
    np.testing.assert_allclose(paths.metres[free], expected, atol=1e-9)
    assert free.sum() > 200


def test_the_next_goal_lies_on_the_path_within_the_distance():
    walk = Walk(flat(), (0.5, 2.0))
    walk.known[:] = True
    paths = _Paths(walk.ground(), walk.here, 0.2)
    far = np.array([3.5, 0.5])
    near = paths.ahead(far, 1.2)
    assert 1.1 <= paths.length(near) <= 1.2 + 1e-9
    onward = _Paths(walk.ground(), near, 0.2)
    assert paths.length(near) + onward.length(far) == pytest.approx(paths.length(far), abs=0.1)


def speckled(side_m: float, seed: int) -> ExplorationMap:
    """A hall with walls 4 m apart and holes of 0.2 m in what was seen."""
    rng, n = np.random.default_rng(seed), round(side_m / CELL)
    occupied = np.zeros((n, n), bool)
    occupied[::80] = True
    occupied[:, 40::160] = False
    known = np.kron(rng.random((n // 4, n // 4)) < 0.97, np.ones((4, 4), bool))
    return ExplorationMap(occupied, known, np.zeros((n, n)), np.zeros(2), CELL)


@pytest.mark.parametrize("seed", range(5))
def test_the_frontier_of_the_largest_gain_is_chosen(seed):
    """Against a plain loop over all of them."""
    ground, explorer, here = speckled(8.0, seed), Explorer(), np.array([2.1, 2.1])
    paths = _Paths(ground, here, explorer._body_m)
    reached = np.argwhere(np.isfinite(paths.metres))
    labels, count = ndimage.label(ground.frontier(), np.ones((3, 3)))
    gains, stands = [], []
    for label in range(1, count + 1):
        cells = np.argwhere(labels == label)
        middle = cells[np.argmin(np.linalg.norm(cells - cells.mean(axis=0), axis=1))]
        away = CELL * np.linalg.norm(reached - middle, axis=1)
        stand = reached[np.argmin(away)]
        counts = len(cells) * CELL >= 0.2 and away.min() <= 0.6
        gains.append(counts * len(cells) * CELL / (0.8 + paths.metres[tuple(stand)]))
        stands.append((stand[::-1] + 0.5) * CELL)
    assert max(gains) > 0.0
    found = explorer._best_frontier(ground, paths)
    np.testing.assert_allclose(found, stands[int(np.argmax(gains))], atol=1e-12)


def test_the_choice_among_hundreds_of_frontiers_takes_a_few_searches_of_paths():
    ground, explorer, here = speckled(40.0, 0), Explorer(), np.array([2.1, 2.1])
    began = time.process_time()
    paths = _Paths(ground, here, explorer._body_m)
    searched = time.process_time()
    assert explorer._best_frontier(ground, paths) is not None
    assert time.process_time() - searched < 5.0 * (searched - began)


def test_an_enclosed_robot_stays():
    occupied = np.ones((20, 20), dtype=bool)
    occupied[8:12, 8:12] = False
    ground = ExplorationMap(occupied, np.ones_like(occupied), np.zeros((20, 20)), np.zeros(2), CELL)
    here = np.array([0.5, 0.5])
    assert float(np.hypot(*(Explorer().goal(ground, here, 0.0) - here))) < 0.2


def test_impossible_settings_are_refused():
    with pytest.raises(ConfigError, match="patience_s"):
        ExplorationConfig(patience_s=0.0)
