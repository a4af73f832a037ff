"""False movers of static recordings: which tracks count, and a ray cast room in which nothing moves."""

from __future__ import annotations

import json

import pytest

from surefoot.evaluation.metrics.obstacles import likeliest_moving
from surefoot.experiments.real import honesty_tracks
from surefoot.experiments.real.replica_room import ReplicaRoom


def row(track: int, stamp: float, seen: float, moving: float) -> dict[str, object]:
    state = {"mean": [0.0] * 4, "covariance": [[0.0] * 4] * 4}
    return {"track": track, "stamp": stamp, "seen": seen, "moving": moving, **state}


def test_a_track_counts_by_its_end_and_by_its_last_detection():
    rows = [
        row(1, 0.0, 0.0, 0.9),
        row(1, 1.0, 1.0, 0.2),  # doubt only in between
        row(2, 0.0, 0.0, 0.7),
        row(2, 1.0, 0.0, 0.4),  # claimed when last seen
        row(3, 0.0, 0.0, 0.1),
        row(3, 1.0, 0.0, 0.8),  # claimed at its end
    ]
    assert likeliest_moving(rows) == pytest.approx({1: 0.2, 2: 0.7, 3: 0.8})


def test_false_movers_are_counted_by_recording_and_in_all(tmp_path, monkeypatch):
    monkeypatch.setattr(honesty_tracks, "ReplicaRoom", lambda path: path)
    monkeypatch.setattr(honesty_tracks.real_data, "folder", lambda name: tmp_path)
    monkeypatch.setattr(honesty_tracks, "tracks_of", lambda room: [row(1, 0.0, 0.0, 0.1)])
    runs = {}
    for name, moving in (("one", 0.6), ("other", 0.5)):
        runs[name] = tmp_path / name
        runs[name].mkdir()
        (runs[name] / "summary.json").write_text("{}", encoding="utf-8")
        log = {"tracks": [row(1, 0.0, 0.0, moving), row(2, 0.0, 0.0, 0.0)]}
        (runs[name] / "obstacles.json").write_text(json.dumps(log), encoding="utf-8")
    figures, table = honesty_tracks.part(runs, lambda text: None)
    assert figures == {
        "static_movers": 1.0,
        "static_movers_one": 1.0,
        "static_movers_other": 0.0,
        "static_movers_replica_rendered": 0.0,
    }
    assert len(table) == 4


def test_no_track_of_the_ray_cast_office_is_claimed_to_move(recordings):
    entries = honesty_tracks.tracks_of(ReplicaRoom(recordings / "replica_office0"), every=125)
    found = likeliest_moving(entries)
    assert found
    assert all(p <= 0.5 for p in found.values())
