"""A run that is killed goes on where it was, to the same bits."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from perception.primitives.errors import InputError
from surefoot.config.schema import Config
from surefoot.run import checkpoint, process

WALK = Path(__file__).parents[3] / "data" / "walk"
SAME = (
    "trajectory.txt", "trajectory_covariance.csv", "floor.csv", "map.pgm", "obstacles.json",
    "innovations.csv", "odometry.csv", "sightings.csv", "cloud.ply",
)  # fmt: skip


class Killed(BaseException):
    """As SIGKILL would, without a chance to tidy up."""


@pytest.mark.usefixtures("without_report")
def test_a_run_that_was_killed_gives_what_an_undisturbed_one_gives(tmp_path, monkeypatch):
    quiet = lambda text: None  # noqa: E731
    process.process(WALK, None, Config(), tmp_path / "whole", quiet)
    monkeypatch.setattr(checkpoint, "EVERY_S", 0.0)
    count = 0

    def kill_later(text):
        nonlocal count
        count += 1
        if count == 20:
            raise Killed

    with pytest.raises(Killed):
        process.process(WALK, None, Config(), tmp_path / "cut", kill_later)
    with next((tmp_path / "cut").glob(".part-floor*")).open("a") as torn:
        torn.write("half a row that was written after the checkp")
    said = []
    process.process(WALK, None, Config(), tmp_path / "cut", said.append, resume=True)
    assert said[0] == "resuming after frame 20"
    for name in SAME:
        assert (tmp_path / "cut" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes(), (
            name
        )
    assert not list((tmp_path / "cut").glob(".part-*"))
    assert not list((tmp_path / "cut").glob(".checkpoint*"))


def test_a_checkpoint_of_another_configuration_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(checkpoint, "EVERY_S", 0.0)

    def kill(text):
        raise Killed

    with pytest.raises(Killed):
        process.process(WALK, None, Config(), tmp_path / "cut", kill)
    other = dataclasses.replace(Config(), seed=1)
    with pytest.raises(InputError, match="another configuration"):
        checkpoint.load(tmp_path / "cut", other)
    (tmp_path / "cut" / checkpoint.NAME).write_bytes(b"no pickle")
    with pytest.raises(InputError, match="cannot be read"):
        checkpoint.load(tmp_path / "cut", Config())
    assert checkpoint.load(tmp_path, Config()) is None
