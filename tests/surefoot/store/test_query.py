"""Questions: right answers over one run and many, nothing changed, no other file opened, mistakes explained."""

from __future__ import annotations

import csv
import json
import os
import shutil
import signal
import subprocess
import sys
import time

import pytest
from click.testing import CliRunner

from perception.primitives.errors import InputError
from surefoot.cli.main import main
from surefoot.cli.terminal import INTERRUPTED
from surefoot.store import query
from surefoot.store.examples import EXAMPLES
from surefoot.store.query import asker
from surefoot.store.run_tables import write_run_tables
from surefoot.store.schema import TABLES

from .make_runs import make_run


@pytest.fixture(scope="module")
def many(tmp_path_factory):
    """Three runs with errors of 1, 2 and 3 cm."""
    place = tmp_path_factory.mktemp("runs")
    for seed in range(3):
        write_run_tables(make_run(place / f"walk-{seed}", seed=seed, ate_m=0.01 * (seed + 1)))
    return place


def surefoot(*words):
    return CliRunner().invoke(main, ["query", *map(str, words)])


def test_a_question_over_many_runs_has_the_answer_that_their_files_give(many):
    done = surefoot("SELECT avg(ate_m) AS mean, count(*) AS n FROM metrics", many, "--json")
    (row,) = json.loads(done.stdout)
    assert row == {"mean": pytest.approx(0.02), "n": 3}


def test_a_question_without_end_ends_at_the_time_limit(many):
    endless = "WITH RECURSIVE t(n) AS (SELECT 1 UNION ALL SELECT 1 FROM t) SELECT count(*) FROM t"
    with asker([many], print) as tables:
        with pytest.raises(InputError, match=r"no answer after 0.5 s"):
            tables.ask(endless, longest_s=0.5)
        assert tables.ask("SELECT count(*) FROM runs").rows == [(3,)]
    done = surefoot(endless, many, "--timeout", "0.5")
    assert done.exit_code == 2
    assert "--timeout SECONDS" in done.output


def test_a_single_run_is_asked_without_a_store(many):
    with asker([many / "walk-1"], print) as tables:
        assert tables.ask("SELECT run, seed FROM runs").rows == [("walk-1", 1)]
    assert not (many / "walk-1/.store").exists()


def test_several_places_give_their_runs_their_own_names(many):
    with asker([many / "walk-1", many], print) as tables:
        rows = tables.ask("SELECT run FROM runs ORDER BY run").rows
    assert len(rows) == len(set(rows)) == 4


def test_single_runs_of_one_name_stay_apart(many, tmp_path):
    for seed in range(2):
        shutil.copytree(many / f"walk-{seed}", tmp_path / str(seed) / "walk")
    places = [tmp_path / str(seed) / "walk" for seed in range(2)]
    with asker(places, print) as tables:
        rows = tables.ask("SELECT run, seed, ate_m FROM runs JOIN metrics USING (run)").rows
    assert sorted(rows) == [
        (f"{places[k]}/walk", k, pytest.approx(0.01 * (k + 1))) for k in range(2)
    ]


def test_every_example_has_an_answer(many):
    listed = surefoot("--examples").stdout
    with asker([many], print) as tables:
        for name, example in EXAMPLES.items():
            assert tables.ask(name).rows
            assert f"{name}: {example.words}" in listed
    assert "walk-2" in surefoot("worst", many).stdout


def test_the_worst_run_comes_first(many):
    with asker([many], print) as tables:
        assert tables.ask("worst").column("run") == ["walk-2", "walk-1", "walk-0"]
        settings = tables.ask("settings")
    assert settings.column("setting") == ["seed"] * 3


@pytest.mark.parametrize(
    "question",
    [
        "DROP VIEW runs",
        "CREATE TABLE mine AS SELECT 1",
        "COPY runs TO '{place}/.store/out.csv'",
        "ATTACH '{place}/.store/other.db'",
        "SET enable_external_access = true",
        "INSTALL httpfs",
        "SELECT 1; SELECT 2",
        "SELECT * FROM read_text('/etc/hostname')",
        "SELECT * FROM read_text('{place}/walk-0/config.toml')",
        "SELECT * FROM glob('/*')",
        "SELECT * FROM read_csv('https://example.org/a.csv')",
        "",
    ],
)
def test_nothing_can_be_changed_and_no_other_file_be_opened(many, question):
    before = {one: one.stat().st_mtime_ns for one in many.rglob("*")}
    with (
        asker([many], print) as tables,
        pytest.raises(InputError, match=r"one SELECT|disabled|locked"),
    ):
        tables.ask(question.format(place=many))
    after = {one: one.stat().st_mtime_ns for one in many.rglob("*") if ".store" not in one.parts}
    assert after == {one: at for one, at in before.items() if ".store" not in one.parts}
    assert not list(many.glob(".store/o*"))


def test_a_mistake_is_explained_with_all_tables_and_columns(many):
    done = surefoot("SELECT ate FROM metrics", many)
    assert done.exit_code == 2
    assert "ate_m" in done.stderr
    for table in TABLES:
        assert f"  {table}: run, " in done.stderr
    assert surefoot("SELECT 1").exit_code == 2  # without runs


def test_a_misspelt_name_is_answered_with_the_name_and_not_with_all_columns(many):
    done = surefoot("worst-frame", many)
    assert done.exit_code == 2
    assert (
        done.stderr.strip()
        == "surefoot: query 'worst-frame' is unknown; did you mean 'worst-frames'?"
    )


def test_all_rows_go_to_csv_and_the_terminal_shows_the_first(many, tmp_path):
    file = tmp_path / "answer.csv"
    done = surefoot("SELECT i, 1 / i AS x, CAST(NULL AS DOUBLE) AS n FROM range(1, 301) AS t(i)", many, "--csv", file)  # fmt: skip
    assert "300 rows, 200 more" in done.stdout
    with file.open(newline="") as opened:
        rows = list(csv.DictReader(opened))
    assert [float(row["x"]) for row in rows] == [1 / i for i in range(1, 301)]
    assert {row["n"] for row in rows} == {""}


def test_a_column_is_drawn_over_another(many, tmp_path):
    question = "SELECT run, seed, ate_m, 'a' AS word FROM runs JOIN metrics USING (run)"
    for x, file in (("seed", "points.svg"), ("run", "bars.png")):
        done = surefoot(question, many, "--plot", x, "ate_m", tmp_path / file)
        assert done.exit_code == 0
        assert (tmp_path / file).stat().st_size > 2000
    for x, y, file in (
        ("seed", "word", "a.svg"),
        ("seed", "none", "a.svg"),
        ("seed", "ate_m", "a.txt"),
    ):
        assert surefoot(question, many, "--plot", x, y, tmp_path / file).exit_code == 2


@pytest.mark.usefixtures("ctrl_c")
def test_ctrl_c_ends_a_question_that_computes(many):
    endless = "SELECT count(*) FROM range(1000000000000) a, range(1000) b"
    words = [sys.executable, "-m", "surefoot", "query", endless, str(many / "walk-0")]
    with subprocess.Popen(words, stderr=subprocess.PIPE, text=True) as asked:
        try:
            while used_s(asked.pid) < 3.0:  # it computes, with all threads of DuckDB
                assert asked.poll() is None
                time.sleep(0.05)
            asked.send_signal(signal.SIGINT)
            _, said = asked.communicate(timeout=20.0)
        finally:
            asked.kill()
    assert asked.returncode == INTERRUPTED
    assert "Traceback" not in said


def used_s(process: int) -> float:
    """Time of the processor that a process has used."""
    with open(f"/proc/{process}/stat", encoding="ascii") as file:
        fields = file.read().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@pytest.mark.parametrize("question", ["SELECT * FROM range(11)", "SELECT i FROM range(10000000000) t(i)"])  # fmt: skip
def test_an_answer_with_too_many_rows_is_refused(many, monkeypatch, question):
    monkeypatch.setattr(query, "MOST_ROWS", 10)
    with asker([many / "walk-0"], print) as tables:
        assert len(tables.ask("SELECT * FROM range(10)").rows) == 10
        with pytest.raises(InputError, match="more than 10 rows; add LIMIT"):
            tables.ask(question)


def test_a_question_that_needs_too_much_memory_is_refused(many, monkeypatch, tmp_path):
    monkeypatch.setattr(query, "MEMORY", "50MB")
    monkeypatch.chdir(tmp_path)
    with (
        asker([many / "walk-0"], print) as tables,
        pytest.raises(InputError, match="needs more than 50MB of memory; add LIMIT") as refused,
    ):
        tables.ask("SELECT i FROM range(100000000) t(i) ORDER BY hash(i)")
    assert "tables and columns" not in str(refused.value)
    assert list(tmp_path.iterdir()) == []  # nothing is spilled


def test_values_of_every_kind_become_json(many):
    done = surefoot(
        "SELECT '11111111-2222-3333-4444-555555555555'::UUID AS u, [u] AS l, {'d': DATE '2020-01-02', 'n': 1.5} AS s, "
        "'nan'::DOUBLE AS x, true AS t",
        many / "walk-0",
        "--json",
    )
    u = "11111111-2222-3333-4444-555555555555"
    expected = {"u": u, "l": [u], "s": {"d": "2020-01-02", "n": 1.5}, "x": None, "t": True}
    assert json.loads(done.stdout) == [expected]


def test_columns_of_one_name_are_numbered(many):
    done = surefoot("SELECT 1 AS x, 2 AS x, 3 AS y, 4 AS x", many / "walk-0", "--json")
    assert json.loads(done.stdout) == [{"x": 1, "x_1": 2, "y": 3, "x_2": 4}]


def test_numbers_that_are_too_large_to_be_drawn_are_named(many, tmp_path):
    for value in ("1e308", "-1e308", "'inf'::DOUBLE"):
        done = surefoot(f"SELECT 1 AS x, {value} AS y", many / "walk-0", "--plot", "x", "y", tmp_path / "p.svg")  # fmt: skip
        assert done.exit_code == 2
        assert "too large to be drawn; leave it out with WHERE" in done.stderr
