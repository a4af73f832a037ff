"""Pages of merged maps: each session for itself, what was merged, and the way to the other parts."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from perception.primitives.gaussian import Gaussian
from surefoot.evaluation.evaluate import evaluate
from surefoot.offline.merge import MergeSummary
from surefoot.report.plots.sessions import sessions
from surefoot.report.plots.top_view import trajectory
from surefoot.report.replay.surroundings import surroundings
from surefoot.report.sections import sessions_section
from surefoot.results.moment import Moment
from surefoot.results.run_folder import COVARIANCE_HEADER, RunFolder, estimate_row

STEPS, LONG_M, APART_M, PAUSE_S = 21, 2.0, 5.0, 10.0


def merged(root: Path, parts: list[list[int]], part: int = 1) -> RunFolder:
    """Straight walks of `LONG_M`, one a session, `APART_M` from the end of one to the beginning of the next."""
    run = RunFolder.create(root)
    here, rows, listed = parts[part - 1], [], []
    for k in range(1, 3):
        begin = here.index(k) * (STEPS - 1 + PAUSE_S) if k in here else 0.0
        listed.append({
            "session": k, "name": "home", "map": f"maps/{k}", "recording": "", "digest": str(k), "frames": STEPS,
            "part": next(n for n, one in enumerate(parts, 1) if k in one), "shift_s": begin, "from_s": begin,
            "to_s": begin + STEPS - 1,
        })  # fmt: skip
        for n in range(STEPS if k in here else 0):
            x = (k - 1) * (LONG_M + APART_M) + n * LONG_M / (STEPS - 1)
            rows.append(
                estimate_row(begin + n, Gaussian(np.array([x, 0.0, 0.0]), 1e-4 * np.eye(3)))
            )
    run.write_csv("trajectory_covariance.csv", COVARIANCE_HEADER, rows)
    run.write_planar_trajectory()
    pair = {
        "sessions": [1, 2], "probability": 1.0 if len(parts) == 1 else 0.0, "merged": len(parts) == 1, "links": 0,
        "views": 0, "compared": 0, "fitting": None, "contradicting": None,
    }  # fmt: skip
    content = {"part": part, "sessions": listed, "pairs": [pair], "parts": parts}
    run.write_json("sessions.json", content)
    run.write_json("summary.json", {"kind": "map", "name": "merge", "trajectory": "camera"})
    return RunFolder.open(root)


@pytest.fixture
def one_map(tmp_path: Path) -> RunFolder:
    return merged(tmp_path / "one", [[1, 2]])


def test_the_way_from_one_session_to_the_next_is_no_path(one_map):
    figures = evaluate(one_map)
    assert figures["path_m"] == pytest.approx(2 * LONG_M)
    assert figures["duration_s"] == pytest.approx(2 * (STEPS - 1))
    assert figures["straight_m"] == pytest.approx(2 * LONG_M + APART_M)


def test_no_line_of_a_picture_joins_two_sessions(one_map):
    for draw in (trajectory, sessions):
        lines = [line.get_xdata() for line in draw(one_map).figure.axes[0].get_lines()]
        paths = [x for x in lines if len(x) > 1]
        assert [float(np.ptp(x)) for x in paths] == pytest.approx([LONG_M, LONG_M])


def test_the_replay_knows_where_a_session_begins(one_map):
    stamps = one_map.read_trajectory("trajectory.txt").stamps
    entries, _ = surroundings(one_map, [Moment(stamp_s=float(stamp)) for stamp in stamps])
    assert entries["begins"] == [0, STEPS]


def test_the_page_of_a_merge_says_what_was_merged_and_leads_to_the_other_parts(one_map, tmp_path):
    assert "2 sessions are merged into this map." in sessions_section(one_map)
    assert "href" not in sessions_section(one_map)
    apart = [merged(tmp_path / str(part), [[1], [2]], part) for part in (1, 2)]
    texts = [sessions_section(run) for run in apart]
    assert all("Nothing was merged" in text for text in texts)
    assert 'href="part-2/report.html"' in texts[0]
    assert 'href="../report.html"' in texts[1]
    assert "maps/1" in texts[0]
    assert "maps/2" in texts[0]
    assert "Nothing changed" in sessions(one_map).sentence
    assert "changed" not in sessions(apart[1]).sentence


def test_two_sessions_that_were_not_compared_have_a_reason_instead_of_a_probability(tmp_path):
    run = merged(tmp_path / "apart", [[1], [2]])
    content = run.read_json("sessions.json")
    content["pairs"][0] |= {"probability": None, "reason": "nothing recognised by depth alone"}
    run.write_json("sessions.json", content)
    assert "not compared: nothing recognised by depth alone" in sessions_section(run)
    pairs = ((1, 2, math.nan, 0, "nothing recognised by depth alone"),)
    summary = MergeSummary("out", ("a", "b"), ((1,), (2,)), pairs, (0, 0), (9, 9))
    words = "sessions 1 and 2: not compared, nothing recognised by depth alone"
    assert words in summary.lines()
