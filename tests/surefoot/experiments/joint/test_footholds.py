"""The experiments on footholds: what counts as a missed edge, and when claims hold."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from mapping.ground.surface import Border
from perception.primitives.pose import Pose2
from perception.primitives.robot_model import RobotModel
from sim.scenes.stairs import KINDS, Level, Terrain, terrain
from surefoot.experiments.joint import footholds, stairs_walk
from surefoot.experiments.joint.footholds import Trial, missed, shifted, true_surfaces
from surefoot.experiments.joint.stairs_walk import Step, Walk

ROBOT = RobotModel(foot_m=(0.2, 0.1))
STEPS = Terrain((Level(-1.0, 1.0, 0.6), Level(1.0, 1.3, 0.7), Level(1.3, 3.0, 0.8)), 0.5)


def test_an_edge_is_missed_by_any_part_of_a_sole_or_where_the_level_is_not():
    assert not missed(STEPS, Pose2(1.15, 0.0), 0.7, ROBOT)
    assert missed(STEPS, Pose2(1.22, 0.0), 0.7, ROBOT)
    assert missed(STEPS, Pose2(1.15, 0.47), 0.7, ROBOT)
    assert missed(STEPS, Pose2(1.15, 0.0), 0.8, ROBOT)
    assert not missed(STEPS, Pose2(1.15, 0.7), 0.0, ROBOT)  # on the floor beside them
    assert missed(STEPS, Pose2(1.15, 0.53), 0.0, ROBOT)


def test_true_surfaces_are_the_levels_as_a_foot_sees_them():
    stands = Pose2(0.5, 0.1, 0.3)
    surfaces = true_surfaces(STEPS, stands, np.full((3, 4), 0.01))
    tread = surfaces[1]
    there = stands.inverse().apply(np.array([1.2, 0.2]))
    assert tread.contains(there)
    assert tread.height_at(there)[0] == pytest.approx(0.1)
    assert tread.borders.tolist() == [Border.DROP, Border.RISE, Border.DROP, Border.DROP]
    wider = shifted(tread, np.array([0.0, 0.05, 0.0, 0.02]))
    back = stands.apply(wider.outline)
    assert back[:, 0].min() == pytest.approx(0.98)
    assert back[:, 0].max() == pytest.approx(1.35)
    assert np.abs(back[:, 1]).max() == pytest.approx(0.5)


@pytest.mark.parametrize("kind", KINDS)
def test_terrains_are_joined_levels_that_the_robot_can_step(kind):
    for seed in range(20):
        levels = terrain(kind, seed).levels
        for one, other in itertools.pairwise(levels):
            assert one.end_m == other.start_m
            assert kind == "trench" or abs(one.height_m - other.height_m) <= 0.1
        assert levels[0].start_m < 0.0 < 0.5 < levels[0].end_m
        assert min(one.height_m for one in levels) >= 0.0


def trial(rate: float) -> Trial:
    """A hundred claims of 0.1, of which a share misses."""
    claims = tuple((0.1, k < 100 * rate) for k in range(100))
    return Trial(claims, claims, (1.0, 30.0), (2.0,))


def test_claims_hold_within_the_binomial_band_only():
    assert footholds.summary([trial(0.10)])[0]["missed_in_band"] == 1.0
    assert footholds.summary([trial(0.30)])[0]["missed_in_band"] == 0.0
    assert footholds.summary([trial(0.00)])[0]["missed_in_band"] == 0.0
    assert footholds.summary([trial(0.10)])[0]["plan_ms_p99"] == pytest.approx(29.7, abs=0.1)


def test_a_walk_with_a_foot_on_an_edge_did_not_climb():
    fine = Walk(1, "arrived", 1.0, (Step(0.01, 1.0, 5.0), Step(0.0, 0.95, 5.0)))
    edge = Walk(2, "edge", 1.0, (Step(0.01, 0.8, 5.0),))
    figures = stairs_walk.summary([fine, edge])
    assert figures["climbed_share"] == 0.5
    assert figures["feet_on_edges"] == 1.0
    assert figures["edges_missed"] == 2.0
    assert figures["edges_missed_claimed"] == pytest.approx(0.02)
