"""A soak walks until its time is over, goes on where it stopped, and tells what grew."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from perception.primitives.errors import OutputError
from sim.faults.injection import KINDS
from surefoot.config.load import load
from surefoot.config.schema import Config
from surefoot.run import soak
from surefoot.run.soak import SCENES, Walk, drawn, figures, lines, read

CHEAP = [
    "robot.colour=false",
    "robot.stereo=false",
    "robot.tof_source=rays",
    "mission.time_limit_s=1.2",
    "faults.begin_s=0.4",
]
WALK = Walk(0, 1, "home", "kinematic", "frozen", 10.0, 60.0, 500.0, 40.0, 0, 0, 0, 3.0)


def test_a_tiny_soak_leaves_its_table_and_goes_on(tmp_path, monkeypatch):
    monkeypatch.setattr(soak, "BODIES", ("kinematic",))
    config = load(None, CHEAP)
    said: list[str] = []
    first = soak.soak(1e-9, tmp_path, config, said.append)
    assert [one.number for one in first] == [0]
    assert said[0].startswith("walk 0, ")
    again = soak.soak(1e-9, tmp_path, config, said.append)
    assert again[0] == first[0]
    assert [(one.number, one.process) for one in again] == [(0, 1), (1, 2)]
    assert read(tmp_path / soak.TABLE) == again
    assert all(one.rss_mb > 50.0 and one.wall_s > 0.0 for one in again)
    assert not list(tmp_path.glob("walk-*"))  # nothing was touched


def test_every_scene_and_fault_has_its_turn_and_a_number_is_always_the_same_walk():
    walks = [drawn(number, Config()) for number in range(200)]
    assert {one.scene for one in walks} == set(SCENES)
    assert {fault for one in walks for fault in one.faults.inject} == set(KINDS)
    assert any(not one.faults.inject for one in walks)
    assert drawn(7, Config()) == walks[7]


def test_growth_of_memory_is_the_slope_after_the_warm_up():
    memory = [200.0, 480.0, *np.arange(500.0, 520.0, 2.0)]  # 2 MB a minute
    walks = [replace(WALK, number=k, rss_mb=float(mb)) for k, mb in enumerate(memory)]
    assert figures(walks)["rss_mb_per_h"] == pytest.approx(120.0)


def test_drift_of_latency_compares_the_halves():
    walks = [replace(WALK, cycle_p99_ms=ms) for ms in (40.0, 40.0, 44.0, 44.0)]
    assert figures(walks)["cycle_p99_drift"] == pytest.approx(0.1)


def test_the_table_has_a_line_for_each_fault():
    text = lines([WALK, replace(WALK, fault="", contacts=2)])
    assert text[1].split()[:3] == ["none", "1", "2"]
    assert text[2].split()[:3] == ["frozen", "1", "0"]


def test_another_table_is_refused(tmp_path: Path):
    (tmp_path / soak.TABLE).write_text("a,b\n1,2\n")
    with pytest.raises(OutputError, match="no table of a soak"):
        read(tmp_path / soak.TABLE)
