"""A store holds every run once, as it is now, whatever was added, changed, deleted, damaged or killed."""

from __future__ import annotations

import os
import shutil

import pytest

from perception.primitives.errors import InputError
from surefoot.store import collection
from surefoot.store.query import asker
from surefoot.store.run_tables import write_run_tables
from surefoot.store.schema import COMMIT, TABLES

from .make_runs import make_run


@pytest.fixture(scope="module")
def four(tmp_path_factory):
    """Four runs with seeds 0 to 3, one of them in a folder of its own, and a folder without runs."""
    place = tmp_path_factory.mktemp("four")
    for seed, name in enumerate(("a", "b", "c", "deep/d")):
        write_run_tables(make_run(place / name, seed=seed))
    (place / "empty").mkdir()
    return place


@pytest.fixture
def many(four, tmp_path):
    """A copy of them."""
    return shutil.copytree(four, tmp_path / "many")


def seeds(place, said=None):
    """Names and seeds of the runs, by a question; checks that every table has each run once."""
    with asker([place], [].append if said is None else said.append) as tables:
        rows = tables.ask("SELECT run, seed FROM runs ORDER BY run").rows
        counts = tables.ask(
            "SELECT run, count(*) FROM frames GROUP BY run UNION ALL SELECT run, 4 * count(*) FROM steps GROUP BY run"
        ).rows
        assert sorted(counts) == sorted([(run, 4) for run, _ in rows] * 2)
    return dict(rows)


def parts(place):
    return sorted(one.name for one in (place / collection.STORE).iterdir())


def test_new_runs_are_added_and_the_others_not_read_again(many):
    assert seeds(many) == {"a": 0, "b": 1, "c": 2, "deep/d": 3}
    assert parts(many) == ["part-000001"]
    write_run_tables(make_run(many / "e", seed=4))
    shutil.rmtree(many / "a/tables")
    (many / "a/tables").mkdir()
    stamp = (many / collection.STORE / "part-000001/runs.parquet").stat().st_mtime_ns
    shutil.copy(many / "e" / COMMIT, many / "a" / COMMIT)
    found, _ = collection.find_runs(many)
    assert set(found) == {"a", "b", "c", "deep/d", "e"}
    shutil.rmtree(many / "a")
    assert seeds(many) == {"b": 1, "c": 2, "deep/d": 3, "e": 4}
    assert (many / collection.STORE / "part-000002/runs.parquet").stat().st_mtime_ns > stamp


def test_names_that_are_patterns_stand_for_one_run(tmp_path):
    names = ["ab", "*", "a?", "[ab]b", "**", "a[", "[!x]b", "it's *", "50%"]
    for seed, name in enumerate(names):
        write_run_tables(make_run(tmp_path / "[runs]" / name, seed=seed))
    (tmp_path / "r").symlink_to("[runs]")
    assert seeds(tmp_path / "[runs]") == {name: seed for seed, name in enumerate(names)}
    assert seeds(tmp_path / "[runs]/*") == {"*": 1}


def test_an_unchanged_folder_leaves_the_store_as_it_is(many):
    seeds(many)
    before = {one: one.stat().st_mtime_ns for one in (many / collection.STORE).rglob("*")}
    seeds(many)
    assert {one: one.stat().st_mtime_ns for one in (many / collection.STORE).rglob("*")} == before


def test_a_run_that_was_written_again_takes_the_place_of_the_old_one(many):
    seeds(many)
    shutil.rmtree(many / "b")
    write_run_tables(make_run(many / "b", seed=77))
    assert seeds(many) == {"a": 0, "b": 77, "c": 2, "deep/d": 3}


def test_small_parts_are_put_together(many, monkeypatch):
    monkeypatch.setattr(collection, "MOST_SMALL", 2)
    for seed in range(4, 8):
        write_run_tables(make_run(many / f"run{seed}", seed=seed))
        assert len(seeds(many)) == seed + 1
        assert len(parts(many)) <= 3


def test_large_folders_become_several_parts(many, monkeypatch):
    monkeypatch.setattr(collection, "PART_RUNS", 3)
    said = []
    assert len(seeds(many, said)) == 4
    assert parts(many) == ["part-000001", "part-000002"]
    assert "store: 3 of 4 runs" in said


def test_a_store_whose_writer_was_killed_is_mended(many):
    seeds(many)
    store = many / collection.STORE
    old = many / "old"
    shutil.copytree(store / "part-000001", old)
    shutil.rmtree(many / "b")
    write_run_tables(make_run(many / "b", seed=77))
    seeds(many)
    os.rename(old, store / "part-000001")  # killed before it was deleted
    shutil.copytree(store / "part-000002", store / ".part-000003")  # and while writing
    (store / ".part-000003/frames.parquet").write_bytes(b"PAR1 cut")
    assert seeds(many) == {"a": 0, "b": 77, "c": 2, "deep/d": 3}
    assert parts(many) == ["part-000002"]


@pytest.mark.parametrize(
    ("table", "harm"), [("runs", "cut"), ("frames", "zeros"), ("config", "text")]
)
def test_a_damaged_run_is_named_and_left_out_until_it_is_mended(many, table, harm):
    file = many / f"c/tables/{table}.parquet"
    data = file.read_bytes()
    harmed = {"cut": data[: len(data) // 2], "zeros": data[:8] + bytes(len(data) - 16) + data[-8:], "text": b"no"}  # fmt: skip
    file.write_bytes(harmed[harm])
    said = []
    assert seeds(many, said) == {"a": 0, "b": 1, "deep/d": 3}
    assert any("c: its tables are damaged" in one for one in said)
    write_run_tables(make_run(many / "mended", seed=9))
    shutil.rmtree(many / "c")
    (many / "mended").rename(many / "c")
    assert seeds(many) == {"a": 0, "b": 1, "c": 9, "deep/d": 3}


def test_where_nothing_may_be_written_questions_are_answered_all_the_same(many, monkeypatch):
    monkeypatch.setattr(collection.os, "access", lambda path, mode: False)
    assert len(seeds(many)) == 4
    assert parts(many) == []


def test_runs_without_tables_are_counted(many):
    make_run(many / "older")
    said = []
    assert "older" not in seeds(many, said)
    assert said == [f"1 runs below {many} have no tables; `surefoot evaluate RUN` writes them"]


def test_a_folder_without_runs_is_refused(tmp_path):
    with pytest.raises(InputError, match="no run with tables"), asker([tmp_path], print):
        pass
    with pytest.raises(InputError, match="no folder"), asker([tmp_path / "absent"], print):
        pass


def test_tables_of_an_older_version_lack_columns_and_those_of_a_newer_one_have_more(many):
    import duckdb

    for name, change in (("a", "* EXCLUDE (qx)"), ("b", "*, 5 AS another")):
        file = many / f"{name}/tables/frames.parquet"
        duckdb.execute(f"COPY (SELECT {change} FROM '{file}') TO '{file}.new' (FORMAT parquet)")
        os.replace(f"{file}.new", file)
    with asker([many], print) as tables:
        rows = tables.ask(
            "SELECT run, count(qx), count(*) FROM frames GROUP BY run ORDER BY run"
        ).rows
        columns = tables.ask("SELECT * FROM frames LIMIT 1").columns
    assert rows[:2] == [("a", 0, 4), ("b", 4, 4)]
    assert columns == ("run", *(one.name for one in TABLES["frames"]))
