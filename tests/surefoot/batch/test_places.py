"""The jobs of places: recordings at any depth, lists, names, seeds, runs."""

from __future__ import annotations

from pathlib import Path

import pytest

from perception.primitives.errors import InputError
from surefoot.batch.job import Job
from surefoot.batch.places import Order, jobs_of_places, jobs_of_seeds, names_of

from .small import made, write_floor

PROCESS = Order("process", overrides=("seed=3",))


def test_recordings_are_found_at_any_depth_and_only_once(recordings, tmp_path):
    places = [str(tmp_path), str(recordings), str(recordings / "day/a")]
    jobs = jobs_of_places(PROCESS, places, tmp_path / "out")
    found = [Path(job.source).relative_to(recordings).as_posix() for job in jobs]
    assert found == ["day/a", "day/b", "night/a", "night/c"]
    assert [job.name for job in jobs] == ["day-a", "b", "night-a", "c"]
    assert jobs[0].target == str(tmp_path / "out/day-a")
    assert {job.overrides for job in jobs} == {("seed=3",)}


def test_a_recording_is_found_once_by_whatever_path(recordings, tmp_path, monkeypatch):
    monkeypatch.chdir(recordings)
    (recordings / "latest").symlink_to("night/c")
    places = ["day/../day", str(recordings), "day/a"]
    jobs = jobs_of_places(PROCESS, places, tmp_path / "out")
    assert sorted(job.name for job in jobs) == ["b", "c", "day-a", "night-a"]


def test_long_names_leave_room_for_the_endings_of_files(tmp_path):
    names = names_of([f"/x/{day}/{'é' * 120}" for day in ("monday", "tuesday")])
    assert len(set(names)) == 2
    assert max(len(name.encode()) for name in names) < 240
    assert names[0].startswith("monday-é")


def test_a_list_names_places_relative_to_itself(recordings, tmp_path):
    (tmp_path / "these.txt").write_text("# two of them\nin/night/c\n\nin/day/b\n")
    jobs = jobs_of_places(PROCESS, [str(tmp_path / "these.txt")], tmp_path / "out")
    assert [job.name for job in jobs] == ["c", "b"]


@pytest.mark.parametrize("place", ["nowhere", "."])
def test_a_place_without_any_is_named(tmp_path, place):
    with pytest.raises(InputError, match=str(tmp_path / place)):
        jobs_of_places(PROCESS, [str(tmp_path / place)], tmp_path / "out")


def test_names_grow_by_folders_until_they_differ():
    sources = ["/x/one/cam/a", "/x/two/cam/a", "s3://lab/x/b.mcap"]
    assert names_of(sources) == ["one-cam-a", "two-cam-a", "b"]
    with pytest.raises(InputError, match="two recordings would both be called"):
        names_of(["s3://lab/a", "s3://lab/a"])


def test_a_job_is_the_same_after_its_way_to_a_worker(tmp_path):
    job = Job("a", "process", "s3://x/a", str(tmp_path), "c.toml", ("seed=3", "x=1"), 7, True, "d")
    assert Job.read(job.line()) == job
    assert "\n" not in job.line()


def test_a_job_for_another_machine_names_its_files_by_whole_paths(recordings, monkeypatch):
    monkeypatch.chdir(recordings)
    there = Job("a", "process", "day/a", "out/a", "c.toml").anywhere()
    assert there.source == str(recordings / "day/a")
    assert (there.target, there.config) == (str(recordings / "out/a"), str(recordings / "c.toml"))
    address = Job("a", "process", "s3://lab/a", "out/a")
    assert (address.anywhere().source, address.anywhere().config) == ("s3://lab/a", "")


def test_seeds_are_a_batch_of_one_walk_each(tmp_path):
    jobs = jobs_of_seeds(Order("simulate", record=True), "home", range(1000, 1003), tmp_path)
    assert [job.name for job in jobs] == ["home-1000", "home-1001", "home-1002"]
    assert [job.seed for job in jobs] == [1000, 1001, 1002]
    assert all(job.record and job.verb == "simulate" for job in jobs)


def test_evaluate_goes_over_complete_runs(tmp_path):
    for name in ("a", "b"):
        write_floor(tmp_path / "in" / name)
    for job in jobs_of_places(PROCESS, [str(tmp_path / "in")], tmp_path / "out"):
        made(job)
    (tmp_path / "out/b/summary.json").unlink()
    jobs = jobs_of_places(Order("evaluate"), [str(tmp_path / "out")], tmp_path / "judged")
    assert [(job.name, job.source, job.target) for job in jobs] == [
        ("a", str(tmp_path / "out/a"), str(tmp_path / "out/a"))
    ]
    with pytest.raises(InputError, match="run folders on a disk"):
        jobs_of_places(Order("evaluate"), ["s3://lab/runs"], tmp_path / "judged")
