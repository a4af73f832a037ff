"""docs/metrics.md lists every figure that the evaluation writes, and no other."""

from __future__ import annotations

import ast
import itertools
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from surefoot.evaluation.foreign_covariance import GROWING, SPACE, Claims
from surefoot.evaluation.foreign_trajectory import read_trajectory
from surefoot.evaluation.metrics.gauge_alignment import aligned_consistency
from surefoot.evaluation.metrics.trajectory import trajectory_metrics
from surefoot.evaluation.referee import judge
from surefoot.evaluation.targets import TARGETS
from surefoot.results.tables import Trajectory

ROOT = Path(__file__).parents[3]
TEXT = (ROOT / "docs" / "metrics.md").read_text(encoding="utf-8")
SOURCES = [
    *(
        ROOT / "surefoot" / "evaluation" / f"{name}.py"
        for name in ("evaluate", "footprints", "referee")
    ),
    ROOT / "surefoot" / "results" / "tracking.py",
    *sorted((ROOT / "surefoot" / "evaluation" / "metrics").glob("*.py")),
]
ELSEWHERE = {"contact_classes.py"}  # figures of experiments
NAME = re.compile(r"`([^`]+)`")
ROWS = [
    [cell.strip() for cell in line.strip("|").split("|")]
    for line in TEXT.splitlines()
    if line.startswith("| `")
]
LISTED = [name for row in ROWS for name in NAME.findall(row[0])]
PLACES = {
    place: NAME.findall(names)
    for place, names in re.findall(r"`(<\w+>)` (?:is )?one of ([^;.]+)[;.]", TEXT)
}


def spelt(name: str) -> list[str]:
    """The names that a name with places stands for."""
    place = re.search(r"<\w+>", name)
    if place is None:
        return [name]
    return list(
        itertools.chain.from_iterable(
            spelt(name.replace(place[0], value, 1)) for value in PLACES[place[0]]
        )
    )


DOCUMENTED = {name for listed in LISTED for name in spelt(listed)}
PARTS = {name for row in ROWS for name in NAME.findall(row[2])}
"""Keys inside a figure, which its meaning names."""


def pattern(key: ast.expr | None) -> str | None:
    """Regular expression of a key in the code; None if it is no text."""
    if isinstance(key, ast.Constant) and isinstance(key.value, str):
        return re.escape(key.value)
    if isinstance(key, ast.JoinedStr):
        parts = (
            re.escape(str(one.value)) if isinstance(one, ast.Constant) else "[a-z0-9_]+"
            for one in key.values
        )
        return "".join(parts)
    return None


def keys_in_code() -> set[tuple[str, str]]:
    """File and pattern of every key that is put into a figure's dictionary."""
    found = set()
    for path in SOURCES:
        if path.name in ELSEWHERE:
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.FunctionDef):
                continue
            for one in ast.walk(node):
                keys: list[ast.expr | None] = []
                if isinstance(one, ast.Dict):
                    keys = list(one.keys)
                elif isinstance(one, ast.DictComp):
                    keys = [one.key]
                elif isinstance(one, ast.Subscript) and isinstance(one.ctx, ast.Store):
                    keys = [one.slice]
                found |= {(path.name, word) for key in keys if (word := pattern(key))}
    return found


def test_every_row_is_complete_and_every_name_is_listed_once():
    assert all(len(row) == 4 and all(row[:3]) for row in ROWS)
    assert len(LISTED) == len(set(LISTED)) > 100
    assert set(PLACES) == {"<claim>", "<camera>", "<filter>", "<component>", "<d>"}


def test_every_key_that_the_code_writes_is_documented():
    missing = [
        (file, word)
        for file, word in keys_in_code()
        if not any(re.fullmatch(f"(surface_)?{word}", name) for name in DOCUMENTED | PARTS)
    ]
    assert missing == []


def test_every_documented_name_is_written_by_the_code():
    words = {word for _, word in keys_in_code()}
    named = {f"ate{part}_m" for part in ("", "_scaled", "_floor")}  # names of a loop
    assert named <= trajectory_metrics(*walks()).keys()
    stale = [
        name for name in DOCUMENTED - named if not any(re.fullmatch(word, name) for word in words)
    ]
    assert stale == []


def walks(n: int = 80) -> tuple[Trajectory, Trajectory]:
    """An estimate and its truth."""
    rng = np.random.default_rng(0)
    stamps = 0.1 * np.arange(n)
    places = np.cumsum(rng.normal(size=(n, 3)), axis=0)
    turns = Rotation.random(n, rng)
    moved = (Rotation.from_rotvec(0.01 * rng.normal(size=(n, 3))) * turns).as_quat()
    found = Trajectory(stamps, places + 0.01 * rng.normal(size=(n, 3)), moved)
    return found, Trajectory(stamps, places, turns.as_quat())


@pytest.mark.parametrize("dof", [3, 6])
def test_figures_with_names_made_at_run_time_are_documented(dof):
    errors = np.random.default_rng(1).normal(size=(60, dof))
    figures = aligned_consistency(errors, np.tile(np.eye(dof), (60, 1, 1)))
    assert figures.keys() <= DOCUMENTED
    assert trajectory_metrics(*walks()).keys() <= DOCUMENTED


def test_every_figure_of_a_judged_trajectory_is_documented(tmp_path):
    for name, one in zip(("found", "true"), walks(), strict=True):
        rows = np.column_stack([one.stamps, one.positions, one.quats_xyzw])
        np.savetxt(tmp_path / f"{name}.txt", rows)
    found, true = (read_trajectory(tmp_path / f"{name}.txt") for name in ("found", "true"))
    step = np.diag([1e-4] * 3 + [1e-9] * 3)
    step[0, 5] = step[5, 0] = 1e-8
    grown = np.arange(1, 81)[:, None, None] * step
    metrics = judge(found, Claims(SPACE, GROWING, np.arange(80), grown), true).metrics
    assert metrics.keys() <= DOCUMENTED
    assert {"motions", "coverage_claimed", "crps_deg", "by_distance"} <= metrics.keys()
    for inner in (metrics["motions"], *metrics["by_component"].values(), *metrics["by_distance"]):
        assert inner.keys() <= PARTS


@pytest.mark.parametrize("target", TARGETS, ids=lambda target: target.figure)
def test_the_page_states_every_target(target):
    good = next(
        row[3] for row in ROWS if any(target.figure in spelt(name) for name in NAME.findall(row[0]))
    )
    exact = "true" if target.bound else "0"
    words = {"<=": f"at most {target.bound:g}", ">=": f"at least {target.bound:g}", "==": exact}
    assert good.removesuffix(" (`tof`)") == words[target.compare]
