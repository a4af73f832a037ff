"""A walk over several levels by depth images and joints: up a kerb, and no further than it can tell."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from sim.scenes import stairs
from sim.scenes.stairs import Level, Terrain
from surefoot.experiments.joint import stairs_walk

CLIMBER = Path(__file__).parents[2] / "little_robot" / "climber.toml"
"""The humanoid of boxes with a depth camera and legs that step up."""


def kerb(riser_m: float) -> Terrain:
    return Terrain((Level(-1.0, 0.7, 0.6), Level(0.7, 2.2, 0.6 + riser_m)), 0.6)


@pytest.fixture(scope="module")
def walks():
    """Ends of walks over a kerb that the robot can climb, and one that it cannot."""
    found = {}
    with pytest.MonkeyPatch.context() as patch:
        for riser_m in (0.08, 0.25):
            patch.setattr(stairs, "terrain", lambda kind, seed, r=riser_m: kerb(r))
            patch.setattr(stairs_walk, "ROBOT", replace(stairs_walk.ROBOT, model=str(CLIMBER)))
            found[riser_m] = stairs_walk.walk(0)
    return found


def test_a_kerb_is_climbed_without_a_foot_on_its_edge(walks):
    assert walks[0.08].end == "arrived"
    assert walks[0.08].up_share == pytest.approx(1.0)
    assert all(step.carried == 1.0 and step.claimed <= 0.01 for step in walks[0.08].steps)


def test_before_a_kerb_that_is_too_high_it_stops(walks):
    assert walks[0.25].end == "unknown"
    assert walks[0.25].up_share == 0.0
    assert all(step.carried == 1.0 for step in walks[0.25].steps)
