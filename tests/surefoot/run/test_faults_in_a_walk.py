"""Faults of a simulated walk: noticed in its status, and in its recording, which replays to the same bits."""

from __future__ import annotations

from pathlib import Path

import pytest

from surefoot.config.load import load
from surefoot.results.run_folder import RunFolder
from surefoot.run import simulate

CHEAP = ["robot.colour=false", "robot.stereo=false", "robot.tof_source=rays"]
WHEN = ["faults.begin_s=1.5", "faults.last_s=2.6", "mission.time_limit_s=6"]
WALKS = {
    "half blind, clock": (["half-blind", "clock-jump"], ["tof half blind", "clock set back"]),
    "frozen, lost": (
        ["frozen", "lost-odometry", "dropped:0.4"],
        ["tof frozen", "no pictures", "no odometry", "gap in stamps"],
    ),
}
"""Name to faults, and what the status says."""


@pytest.fixture(scope="module", params=WALKS)
def walked(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[list[str], Path]:
    """What the status has to say, and the live run with its recording."""
    faults, said = WALKS[request.param]
    injected = ", ".join(f'"{one}"' for one in faults)
    config = load(None, [*CHEAP, *WHEN, f"faults.inject=[{injected}]"], scene="home", seed=1)
    live = tmp_path_factory.mktemp("walk") / "live"
    simulate.simulate(config, live, True, lambda text: None)
    return said, live


def test_the_status_names_the_faults_while_they_last(walked):
    said, live = walked
    run = RunFolder.open(live)
    entries = {one["status"]: one for one in run.read_json("summary.json")["status"]}
    for words in said:
        assert words in entries
        assert 1.5 <= entries[words]["from_s"] < 6.5
    touched = run.read_csv("truth/faults.csv").numbers("stamp_s")
    assert 1.5 <= touched.min() < 3.0


def test_the_recording_holds_the_faults_and_replays_to_the_same_bits(
    walked, assert_same_offline, tmp_path
):
    _, live = walked
    assert_same_offline(live)
    assert (live / "status.csv").read_bytes() == (tmp_path / "offline/status.csv").read_bytes()


def test_a_robot_without_pictures_or_odometry_stands(walked):
    said, live = walked
    run = RunFolder.open(live)
    commands = run.read_csv("commands.csv")
    reasons = commands.words("why")
    lost = {"lost"} & {one["status"] for one in run.read_json("summary.json")["status"]}
    asked = {"no pictures", "no odometry"} & set(said) | lost
    standing = [k for k, why in enumerate(reasons) if why.startswith("stand: ")]
    assert bool(standing) == bool(asked)
    steps = commands.matrix("forward_m", "lateral_m", "turn_rad")
    assert not steps[standing].any()
