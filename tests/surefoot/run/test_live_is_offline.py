"""A recording processed offline gives the estimates of the live walk, bit for bit, for every planner and both bodies."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from planning.planners.depth_loss_fallback import BY_COLOUR
from planning.planners.stuck_recovery import RECOVERY
from surefoot.config.load import load
from surefoot.results.run_folder import RunFolder
from surefoot.run import process, simulate

TABLES = (
    "trajectory_covariance.csv",
    "trajectory.txt",
    "obstacles.json",
    "innovations.csv",
    "floor.csv",
    "map.pgm",
    "cloud.ply",
)

SLOT = """
extent = [0, 0, 3, 2.4]
start = [0.5, 1.2, 0]
goals = [[2.4, 1.2]]
[[box]]
name = "left"
at = [1.5, 1.79]
size = [0.24, 1.18, 0.32]
[[box]]
name = "right"
at = [1.5, 0.47]
size = [0.24, 0.94, 0.32]
"""
"""A gap of 26 cm, narrower than the disc that the search plans for."""

WALKS = {
    "search": ("home", 10.0, []),
    "search, dynamic body": ("home", 6.0, ["robot.body=dynamic"]),
    "field": ("home", 8.0, ["mission.planner=field"]),
    "swarm": ("robots_room", 12.0, ["mission.planner=swarm"]),
    "swarm, optical flow": (
        "robots_room",
        5.0,
        ["mission.planner=swarm", "swarm.version=published"],
    ),
    "avoidance": ("home", 10.0, ["mission.planner=avoidance", "robot.stereo=false"]),
    "fall-back": ("plain_room", 8.0, ["robot.tof=false"]),
    "recovery": (SLOT, 45.0, ["robot.stereo=false"]),
}
"""Name to scene, time limit in s, and settings."""


def quiet(text: str) -> None:
    """No progress in tests."""


@pytest.fixture(scope="module", params=WALKS)
def both(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[str, Path, Path]:
    """Name of the walk, its live run and the run of its recording."""
    scene, limit_s, settings = WALKS[request.param]
    folder = tmp_path_factory.mktemp("walk")
    if "\n" in scene:
        (folder / "scene.toml").write_text(scene)
        scene = str(folder / "scene.toml")
    asked = load(None, [*settings, f"mission.time_limit_s={limit_s}"], scene=scene, seed=1)
    live, offline = folder / "live", folder / "offline"
    simulate.simulate(asked, live, True, quiet)
    process.process(live, None, load(live / "config.toml"), offline, quiet)
    return request.param, live, offline


def test_every_table_and_map_is_the_same_offline(both):
    _, live, offline = both
    for name in TABLES:
        assert (live / name).is_file() == (offline / name).is_file(), name
        if (live / name).is_file():
            assert (live / name).read_bytes() == (offline / name).read_bytes(), name
    if not (live / "terrain.npz").is_file():  # without depth there is no grid
        return
    with np.load(live / "terrain.npz") as one, np.load(offline / "terrain.npz") as other:
        assert set(one.files) == set(other.files)
        for key in one.files:
            np.testing.assert_array_equal(one[key], other[key], err_msg=key)


def test_the_walk_has_what_it_is_compared_for(both):
    name, live, _ = both
    run = RunFolder.open(live)
    commands = run.read_csv("commands.csv")
    assert commands is not None
    why = commands.words("why")
    tracks = json.loads((live / "obstacles.json").read_text())["tracks"]
    if name.startswith("swarm"):
        assert len(tracks) > 10
    if name == "fall-back":
        assert any(word.startswith(BY_COLOUR) for word in why)
    if name == "recovery":
        assert any(word.startswith(RECOVERY) for word in why)
    if name in ("search", "field", "avoidance"):
        innovations = run.read_csv("innovations.csv")
        assert innovations is not None
        assert len(innovations.words("source")) >= 10
