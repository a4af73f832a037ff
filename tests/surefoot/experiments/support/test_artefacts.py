"""The folder of an experiment is complete, agrees with its figures, and is replaced only by another whole one."""

from __future__ import annotations

import csv
import json
import math
import re
import subprocess
import sys
from types import ModuleType

import numpy as np
import pytest
from click.testing import CliRunner

from perception.primitives.errors import InputError, OutputError
from surefoot.cli.main import main
from surefoot.experiments.support import artefacts, experiment, papers, reproduce
from surefoot.experiments.support.experiment import Experiment, Outcome, Target
from surefoot.report.plots import figures as figure_plot
from surefoot.report.plots import style

TARGETS = {
    "error_m": Target("<=", 0.1),
    "found_share": Target(">=", 0.9),
    "contacts": Target("==", 0.0),
    "never": Target("<", 1.0),
}


def quiet(text):
    pass


def measure(seeds, say):
    figures = {"error_m": 0.3, "found_share": 0.95, "contacts": 0.0, "its_error_m": math.inf}
    figures["odd_nan"] = math.nan
    columns = [("error, m", 0.2, "its_error_m", "error_m")]
    pictures = [
        style.Drawing(name, f"Picture <{name}>.", lambda: style.image(np.zeros((40, 60, 3), np.uint8)))
        for name in ("first", "second")[: 1 + (seeds > 1)]
    ]  # fmt: skip
    return Outcome(figures, ["a table & <more>"], columns, pictures)


def tiny(run=measure, identity="tiny"):
    return Experiment(identity, "A tiny & <odd> experiment", run, TARGETS, {"error_m": 0.2}, seeds=4)  # fmt: skip


def perform(tmp_path, one=None, seeds=4):
    order = artefacts.Order(one or tiny(), seeds, None, f"surefoot experiment tiny --seeds {seeds}")
    return artefacts.perform(order, tmp_path / "out", quiet)


def test_the_folder_holds_all_files_and_the_csv_equals_the_json(tmp_path):
    result = perform(tmp_path)
    out = tmp_path / "out"
    assert json.loads((out / "result.json").read_text()) == result
    assert {one.name for one in out.iterdir()} == set(result["files"])
    for name in ("figure.svg", "figure.png", "second.svg", "figures.png", "table.tex", "report.html"):  # fmt: skip
        assert (out / name).stat().st_size > 100
    with (out / "figures.csv").open() as table:
        rows = {row["figure"]: row for row in csv.DictReader(table)}
    assert list(rows) == [*result["figures"], "never"]
    for name, value in result["figures"].items():
        assert rows[name]["value"] == ("" if value is None else repr(value))
    for name, (relation, bound) in result["targets"].items():
        assert (rows[name]["relation"], float(rows[name]["bound"])) == (relation, bound)
    assert [rows[name]["met"] for name in TARGETS] == ["0", "1", "1", "0"]
    assert result["passed"] is False


def test_a_miss_says_its_direction():
    result = {"figures": {"a": 0.3, "b": 0.5, "d": 1.0}, "targets": {"a": ["<=", 0.1], "b": [">=", 0.9], "c": ["<", 1.0], "d": ["<", 1.0]}}  # fmt: skip
    words = [one["words"] for one in artefacts.verdicts(result)]
    assert words == ["too high by 0.2", "too low by 0.4", "not measured", "at the bound"]


def test_the_page_loads_nothing_and_shows_paper_targets_and_pictures(tmp_path):
    perform(tmp_path, tiny(measure))
    page = (tmp_path / "out" / "report.html").read_text()
    assert not re.search(r"(?:src|href)=\"(?!data:)", page)
    assert page.count("<img") == 3
    assert "A tiny &amp; &lt;odd&gt; experiment" in page
    assert "✗ too high by 0.2" in page
    assert "2 of 3 targets met, 1 not measured" in page
    assert "surefoot experiment tiny --seeds 4" in page


def test_a_smaller_result_leaves_no_picture_of_the_earlier_one_and_files_of_the_user_stay(tmp_path):
    perform(tmp_path)
    (tmp_path / "out" / "notes.txt").write_text("mine")
    perform(tmp_path, seeds=1)
    assert not (tmp_path / "out" / "second.png").exists()
    assert (tmp_path / "out" / "notes.txt").read_text() == "mine"


@pytest.mark.parametrize(("where", "stop"), [("run", KeyboardInterrupt), ("draw", RuntimeError)])
def test_an_experiment_that_is_stopped_leaves_the_earlier_result_whole(tmp_path, where, stop):
    perform(tmp_path, seeds=1)
    before = {one.name: one.read_bytes() for one in (tmp_path / "out").iterdir()}

    def stopped(*words):
        raise stop

    def half(seeds, say):
        return Outcome({"error_m": 1.0}, drawings=[style.Drawing("first", "", stopped)])

    with pytest.raises(stop):
        perform(tmp_path, tiny(stopped if where == "run" else half))
    assert {one.name: one.read_bytes() for one in (tmp_path / "out").iterdir()} == before


def test_a_folder_with_other_files_a_file_and_an_impossible_folder_are_refused_at_once(tmp_path):
    ran = []
    one = tiny(lambda seeds, say: ran.append(1) or measure(seeds, say))
    order = artefacts.Order(one, 1, None, "")
    (tmp_path / "report.html").write_text("mine")
    for place, words in (
        (tmp_path, "not empty and not that of an experiment"),
        (tmp_path / "report.html", "is a file"),
        (tmp_path / "report.html" / "below", "a part of its path is a file"),
    ):
        with pytest.raises(OutputError, match=words):
            artefacts.perform(order, place, quiet)
    assert ran == []
    assert (tmp_path / "report.html").read_text() == "mine"


def test_two_processes_do_not_write_into_one_experiment(tmp_path):
    code = f"""
from pathlib import Path
from surefoot.results.run_folder import RunFolder
held = RunFolder(Path({str(tmp_path / "out")!r}))
held.root.mkdir()
held.hold()
print(flush=True)
input()
"""
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    with subprocess.Popen([sys.executable, "-c", code], **pipes) as other:
        other.stdout.readline()
        with pytest.raises(OutputError, match="another process writes into"):
            perform(tmp_path)
        other.communicate("\n")
    assert list((tmp_path / "out").iterdir()) == []
    perform(tmp_path, seeds=1)


def test_what_a_killed_experiment_left_unfinished_is_swept(tmp_path):
    result = perform(tmp_path, seeds=1)
    for left in ("out/.part-1-dead", "out/trials"):
        (tmp_path / left).mkdir()
    (tmp_path / "out/trials/.part-dead.trial").write_text("half")
    perform(tmp_path, seeds=1)
    assert {one.name for one in (tmp_path / "out").iterdir()} == {*result["files"], "trials"}
    assert list((tmp_path / "out/trials").iterdir()) == []


@pytest.mark.parametrize(
    "changed", [{"targets": {"a": ["?", 1.0]}}, {"figures": []}, {"seeds": "4"}, {"title": None}]
)
def test_a_result_that_is_none_is_no_result(tmp_path, changed):
    result = perform(tmp_path, seeds=1)
    assert artefacts.read(tmp_path / "out") == result
    (tmp_path / "out" / "result.json").write_text(json.dumps(result | changed))
    assert artefacts.read(tmp_path / "out") is None


def test_the_result_of_a_quick_round_can_be_read(tmp_path):
    one = tiny(lambda seeds, say, **arguments: measure(seeds, say))
    first, *others = reproduce.SMALLER.values()
    order = artefacts.Order(one, 1, None, "surefoot reproduce --quick", smaller=first)
    result = artefacts.perform(order, tmp_path / "out", quiet)
    assert artefacts.read(tmp_path / "out")["smaller"] == first
    for smaller in others:
        written = json.dumps(result | {"smaller": smaller})
        (tmp_path / "out" / "result.json").write_text(written)
        assert artefacts.read(tmp_path / "out")["smaller"] == smaller


@pytest.mark.parametrize("name", experiment.names())
def test_every_experiment_draws_its_targets_and_names_its_source(name):
    one = experiment.load(name)
    figures = dict.fromkeys([*one.targets, *one.published], 0.5)
    result = experiment.judge(one, Outcome(figures)) | {"intervals": {}}
    drawn = figure_plot.drawing(result).draw()
    shown = sum(len(axes.get_yticks()) for axes in drawn.axes)
    assert shown == len(figures) > 0
    assert len(papers.origin(one).about) > 40
    if papers.room_of(name) in papers.PAPERS:
        assert papers.PAPERS[papers.room_of(name)] in papers.origin(one).papers
        assert papers.origin(one).source


def test_the_papers_are_those_of_the_bibliography():
    from pathlib import Path

    text = " ".join((Path(__file__).parents[4] / "docs" / "bibliography.md").read_text().split())
    for key in ("000", "001", "004"):
        assert papers.PAPERS[key].title in text
        assert papers.PAPERS[key].authors in text


@pytest.fixture
def three(monkeypatch):
    """A registry of three experiments: one that measures, one that fails, one without its recording."""
    calls = []

    def counted(seeds, say):
        calls.append(seeds)
        return measure(seeds, say)

    def failing(seeds, say):
        raise ZeroDivisionError("no <floor>")

    def absent(seeds, say):
        raise InputError("recording 'x' not found")

    registry = {}
    for name, run in (("good", counted), ("bad", failing), ("away", absent)):
        module = ModuleType(f"surefoot.experiments.joint.tiny_{name}")
        module.EXPERIMENT = tiny(run, name)
        monkeypatch.setitem(sys.modules, module.__name__, module)
        registry[name] = f"joint.tiny_{name}"
    monkeypatch.setattr(experiment, "FILES", registry)
    monkeypatch.setattr(papers, "FILES", registry)
    return calls


def states(told):
    return {one.id: one.state for one in told}


def test_a_round_goes_on_after_a_failure_and_does_not_repeat_what_is_finished(tmp_path, three):
    told = reproduce.reproduce(None, True, tmp_path, quiet, quiet)
    assert states(told) == {"good": "done", "bad": "failed", "away": "absent"}
    page = (tmp_path / "index.html").read_text()
    assert 'src="good/figure.png"' in page
    assert (tmp_path / "good" / "figure.png").is_file()
    assert "no &lt;floor&gt;" in page
    assert "recording &#x27;x&#x27; not found" in page
    assert states(reproduce.reproduce("joint", True, tmp_path, quiet, quiet))["good"] == "kept"
    assert three == [1]
    reproduce.reproduce("joint", False, tmp_path, quiet, quiet)  # more seeds
    reproduce.reproduce("joint", True, tmp_path, quiet, quiet)  # fewer: the larger study stays
    assert three == [1, 4]


def test_other_code_makes_a_result_old(tmp_path, three, monkeypatch):
    reproduce.reproduce(None, True, tmp_path, quiet, quiet)
    monkeypatch.setattr(reproduce, "code_hash", lambda: "f" * 64)
    reproduce.reproduce(None, True, tmp_path, quiet, quiet)
    assert three == [1, 1]


def test_processes_side_by_side_give_the_same_result_as_one(tmp_path, monkeypatch):
    found = []
    for jobs in (1, 2):
        folder = tmp_path / str(jobs)
        monkeypatch.setattr(reproduce, "chosen", lambda paper: ["003-E5"])
        told = reproduce.reproduce("003", True, folder, quiet, quiet, jobs)
        assert states(told) == {"003-E5": "done"}
        found.append(json.loads((folder / "003-E5" / "result.json").read_text())["figures"])
    assert found[0] == found[1]


def test_the_verb_names_the_failed_ones_and_fails(tmp_path, three):
    result = CliRunner().invoke(main, ["reproduce", "joint", "--out", str(tmp_path)])
    assert result.exit_code == 1
    assert "failed: bad" in result.stderr
    assert "could not run, see the page: away" in result.stdout
    assert f"page: {tmp_path / 'index.html'}" in result.stdout


def test_a_real_experiment_leaves_a_complete_folder(tmp_path):
    words = ["experiment", "003-E5", "--seeds", "3", "--out", str(tmp_path / "e5"), "--json"]
    result = CliRunner().invoke(main, words)
    assert result.exit_code == 0, result.output
    printed = json.loads(result.stdout)
    assert printed == json.loads((tmp_path / "e5" / "result.json").read_text())
    assert all((tmp_path / "e5" / name).is_file() for name in printed["files"])
    assert "KMHROBO" in printed["papers"][0]
