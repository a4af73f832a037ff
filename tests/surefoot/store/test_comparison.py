"""Two sides: what is paired with what, what is called different, and the page that shows it."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from perception.primitives.errors import InputError
from surefoot.cli.main import main
from surefoot.store.compare_page import lines
from surefoot.store.comparison import BETTER, SILENT, WORSE, compared, shown_change
from surefoot.store.run_tables import write_run_tables
from surefoot.store.sides import Side, read_side

from .make_runs import make_run


def side(name, **figures):
    """A side with one run for each value of its figures."""
    count = len(next(iter(figures.values())))
    keys = [f"sequence {k}" for k in range(count)]
    rows = {key: {n: float(v[k]) for n, v in figures.items() if v[k] is not None} for k, key in enumerate(keys)}  # fmt: skip
    same = {key: key for key in keys}
    return Side(name, Path(name), ("0.1.0",), rows, same, same, {})


def verdicts(first, second):
    return {one.figure.name: one for one in compared(first, second).judged}


def noisy(seed, count=40, sigma=0.02):
    """Trajectory errors of recordings from easy to difficult, m."""
    hard = np.random.default_rng(1).lognormal(math.log(0.03), 0.8, count)
    return hard * np.random.default_rng(seed).lognormal(0.0, sigma, count)


def test_a_change_of_two_per_cent_is_found_among_recordings_that_differ_by_far_more():
    found = verdicts(side("a", ate_m=noisy(2)), side("b", ate_m=1.02 * noisy(3)))["ate_m"]
    assert found.verdict == WORSE
    assert found.low < 0.02 < found.high
    assert abs(found.change - 0.02) < 0.01
    assert verdicts(side("a", ate_m=1.02 * noisy(2)), side("b", ate_m=noisy(3)))["ate_m"].verdict == BETTER  # fmt: skip


def test_more_of_what_should_be_much_is_better_and_nees_is_best_at_one():
    count = np.arange(20.0)
    low, high = (
        side("a", floor_share=0.5 + 0.001 * count),
        side("b", floor_share=0.6 + 0.002 * count),
    )
    assert verdicts(low, high)["floor_share"].verdict == BETTER
    careful, sure = (
        side("a", pose_nees=0.5 + 0.001 * count),
        side("b", pose_nees=1.5 + 0.001 * count),
    )
    better = verdicts(careful, sure)["pose_nees"]
    assert better.verdict == BETTER  # half as large is further off
    assert shown_change(better).startswith("distance from 1: -")
    assert verdicts(sure, side("c", pose_nees=3.0 + 0.001 * count))["pose_nees"].verdict == WORSE


def test_equal_runs_are_equal_and_time_is_never_judged():
    same = {"ate_m": noisy(2), "contacts": np.zeros(40)}
    found = verdicts(side("a", **same, frame_ms=noisy(4)), side("b", **same, frame_ms=2 * noisy(5)))
    assert found["ate_m"].verdict == found["contacts"].verdict == "equal in every pair"
    assert found["frame_ms"].verdict == "not judged"
    assert found["frame_ms"].change == pytest.approx(1.0, abs=0.02)


def test_few_pairs_are_called_too_few():
    found = verdicts(side("a", ate_m=[0.01] * 4), side("b", ate_m=[0.02, 0.021, 0.022, 0.023]))
    assert found["ate_m"].verdict == "too few pairs: 4 differ, 10 needed"
    for count, without in ((5, True), (6, False)):
        more = verdicts(
            side("a", ate_m=[0.01] * count), side("b", ate_m=0.02 + 0.001 * np.arange(count))
        )
        assert shown_change(more["ate_m"]).endswith(" %, no interval") == without


def test_a_loss_that_the_printed_digits_do_not_show_is_no_worst_case():
    found = verdicts(side("a", ate_m=[0.08653, 0.02]), side("b", ate_m=[0.086531, 0.03]))
    assert found["ate_m"].worst == ("sequence 1",)


def test_a_figure_is_compared_over_the_pairs_that_both_know():
    found = verdicts(side("a", ate_m=[0.1, None, 0.3]), side("b", ate_m=[0.1, 0.2, None]))
    assert found["ate_m"].difference.number == 1
    with pytest.raises(InputError, match="in common"):
        compared(side("a", ate_m=[0.1]), Side("b", Path("b"), (), {"x": {}}, {"x": "x"}, {"x": "x"}, {}))  # fmt: skip


def test_what_only_one_side_has_is_named():
    first = side("before", ate_m=[0.1, 0.2, 0.3, None], contacts=[0, 0, 1, 0])
    second = side("after", ate_m=[0.1, None, None, 0.4], contacts=[0, 0, 1, 0])
    for name, of in (("lost", first), ("new", second)):
        of.metrics[name], of.labels[name] = {"ate_m": 0.5}, name
    found = compared(first, second)
    assert found.left_out == [
        "1 of 5 only in before (lost)",
        "ate_m of 2 pairs only in before (sequence 1, sequence 2)",
        "1 of 5 only in after (new)",
        "ate_m of 1 pair only in after (sequence 3)",
    ]
    assert found.content()["left_out"] == found.left_out
    assert lines(found)[-1] == "not compared: " + "; ".join(found.left_out)
    assert compared(first, first).left_out == []


def test_more_figures_ask_for_more_evidence():
    names = ("ate_m", "position_rmse_m", "heading_rmse_deg", "rpe_1s_m", "ospa_m", "tilt_error_deg")
    first, second = {"ate_m": noisy(2)}, {"ate_m": 1.011 * noisy(3)}
    others = {name: noisy(10 + k) for k, name in enumerate(names[1:])}
    again = {name: noisy(20 + k) for k, name in enumerate(names[1:])}
    alone = verdicts(side("a", **first), side("b", **second))["ate_m"]
    among = verdicts(side("a", **first, **others), side("b", **second, **again))
    assert among["ate_m"].adjusted == pytest.approx(6 * alone.adjusted)
    assert all(among[name].verdict == SILENT for name in names[1:])


@pytest.fixture(scope="module")
def two(tmp_path_factory):
    """Two folders with the same three recordings under other names, and three walks; the second side is worse."""
    place = tmp_path_factory.mktemp("two")
    for name, worse in (("a", 1.0), ("b", 1.5)):
        for k in range(3):
            ate_m = worse * 0.01 * (k + 1)
            write_run_tables(make_run(place / f"{name}/{name}-rec{k}", ate_m=ate_m, recording=f"digest-{k}"))  # fmt: skip
            write_run_tables(make_run(place / f"{name}/{name}-walk{k}", ate_m=ate_m, seed=k))
    views = place / "b/b-rec2/views"
    views.mkdir()
    (views / "000.jpg").write_bytes(b"\xff\xd8 picture")
    listed = '[{"stamp": 1.0, "name": "colour", "file": "views/000.jpg"}]'
    (place / "b/b-rec2/views.json").write_text(listed, encoding="utf-8")
    return place


def test_runs_are_paired_by_recording_wherever_it_lies_and_walks_by_scene_and_seed(two):
    first, second = read_side(two / "a", print), read_side(two / "b", print)
    found = compared(first, second)
    assert {(Path(first.runs[k]).name, Path(second.runs[k]).name) for k in found.pairs} == {
        *((f"a-rec{k}", f"b-rec{k}") for k in range(3)),
        *((f"a-walk{k}", f"b-walk{k}") for k in range(3)),
    }
    (ate,) = [one for one in found.judged if one.figure.name == "ate_m"]
    assert ate.change == pytest.approx(0.5)


def test_the_page_shows_the_worst_cases_loads_nothing_and_links_to_the_runs(two, tmp_path):
    page = two / "compare.html"
    words = ["compare", str(two / "a"), str(two / "b"), "--out", str(page), "--json"]
    done = CliRunner().invoke(main, words)
    assert done.exit_code == 0, done.output
    (content,) = json.loads(done.stdout)
    assert content["pairs"] == 6
    assert content["equal"] is True  # too few to tell
    assert content["figures"]["ate_m"]["change"] == pytest.approx(0.5)
    text = page.read_text(encoding="utf-8")
    assert not re.search(r'(src|href)="(https?:)?//', text)
    links = re.findall(r'<a href="([^"]+/report\.html)"', text)
    assert "b/b-rec2/report.html" in links
    assert "a/a-rec2/report.html" in links
    assert text.count("data:image/jpeg") == 1
    assert "<polyline" in text


def test_a_run_can_be_compared_with_another(two):
    words = ["compare", str(two / "a/a-walk1"), str(two / "b/b-walk1"), "--out", str(two / "one.html")]  # fmt: skip
    done = CliRunner().invoke(main, words)
    assert "too few pairs" in done.stdout
    assert done.exit_code == 0
