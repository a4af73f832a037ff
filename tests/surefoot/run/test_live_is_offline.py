"""A recording processed offline gives the estimates of the live walk, bit for bit, whatever planned the steps.

Walks by search, by colour, by another body, and out of a dead end are compared where they are tested:
`test_whole_chain`, `test_swarm_walk`, `test_depth_loss_fallback`, `test_stuck_recovery`.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from surefoot.config.load import load
from surefoot.results.run_folder import RunFolder
from surefoot.run import simulate

WALKS = {
    "field, fixed lag": (
        "home",
        7.0,
        ["mission.planner=field", "localiser.lag_s=5", "robot.stereo=false"],
    ),
    "swarm, optical flow": (
        "robots_room",
        5.0,
        ["mission.planner=swarm", "swarm.version=published"],
    ),
    "avoidance": ("home", 10.0, ["mission.planner=avoidance", "robot.stereo=false"]),
}
"""Name to scene, time limit in s, and settings."""


@pytest.fixture(scope="module", params=WALKS)
def walked(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[str, Path]:
    """Name of the walk, and its live run with the recording."""
    scene, limit_s, settings = WALKS[request.param]
    asked = load(None, [*settings, f"mission.time_limit_s={limit_s}"], scene=scene, seed=1)
    live = tmp_path_factory.mktemp("walk") / "live"
    simulate.simulate(asked, live, True, lambda text: None)
    return request.param, live


def test_every_table_and_map_is_the_same_offline(walked, assert_same_offline):
    assert_same_offline(walked[1])


def test_the_walk_has_what_it_is_compared_for(walked):
    name, live = walked
    run = RunFolder.open(live)
    if name == "swarm, optical flow":
        assert len(run.read_json("obstacles.json")["tracks"]) > 10
    else:  # landmarks were seen
        assert len(run.read_csv("innovations.csv").words("source")) >= 10
