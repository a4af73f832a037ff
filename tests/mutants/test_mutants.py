"""Planted bugs: which ones, where, and that the tests of a small project notice them or not."""

from __future__ import annotations

import ast
import shutil
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

import run_mutants
from changes import changed, changes
from nearby import tests_of as nearby_tests
from run_mutants import ROOT, Tree, Tried, summary

AREA = '''"""An area."""
LARGEST_M2 = 5.0


def area(width: "1 + 1", height) -> "2 * 3":
    """Width times height - or less."""
    if width < 0 and not height:
        raise ValueError(f"{width + height}")
    return min(width * -height, LARGEST_M2)
'''
KERNEL = '''"""A sum, compiled."""
from perception.primitives.compiled import njit


@njit(cache=True)
def total(one: float, other: float) -> float:
    """One and other."""
    return one + other
'''


def test_every_kind_of_slip_is_made_and_nothing_else():
    found = {(one.kind, one.before, one.after) for one in changes(AREA)}
    assert found == {
        ("number", "5.0", "50.0"),
        ("logic", "width < 0 and (not height)", "width < 0 or not height"),
        ("comparison", "width < 0", "width >= 0"),
        ("number", "0", "1"),
        ("logic", "not height", "height"),
        ("extreme", "min(width * -height, LARGEST_M2)", "max(width * -height, LARGEST_M2)"),
        ("arithmetic", "width * -height", "width / -height"),
        ("sign", "-height", "height"),
    }


@pytest.mark.parametrize(
    ("code", "kind"),
    [("a[0] = b", "dropped"), ("a += b", "dropped"), ("a.sort()", "dropped"), ("a = 2", "number")],
)
def test_statements_are_dropped_where_the_code_stays_valid(code, kind):
    assert kind in {one.kind for one in changes(f"def f(a, b):\n    {code}\n")}
    assert not [one for one in changes("def f(a):\n    b = a\n") if one.kind == "dropped"]


def without_brackets(code: str) -> str:
    return code.replace("(", "").replace(")", "")


@pytest.mark.parametrize("one", changes(AREA), ids=lambda one: one.after)
def test_a_changed_file_is_the_original_with_that_change(one):
    unchanged = ast.unparse(ast.parse(AREA)).splitlines()
    lines = zip(unchanged, changed(AREA, one.number).splitlines(), strict=True)
    ((before, after),) = [pair for pair in lines if pair[0] != pair[1]]
    before, old, new = (without_brackets(code) for code in (before, one.before, one.after))
    assert before.replace(old, new) == without_brackets(after)


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """Two modules, one of them compiled, and their tests; the test of the area sees its sign only."""
    files = {
        "perception/floor/area.py": AREA,
        "perception/floor/sum_kernels.py": KERNEL,
        "mapping/__init__.py": '"""Nothing."""\n',
        "planning/__init__.py": '"""Nothing."""\n',
        "tests/perception/floor/test_area.py": "import pytest\n\nfrom perception.floor.area import area\n\n\n"
        "@pytest.mark.parametrize('height', [3.0], ids=['3 m - high'])\n"
        "def test_the_area_is_negative(height):\n    assert area(2.0, height) < 0, '[1] - 2'\n",
        "tests/perception/floor/test_sum.py": "from perception.floor import sum_kernels\n\n\n"
        "def test_one_and_two_are_three():\n    assert sum_kernels.total(1.0, 2.0) == 3.0\n",
    }
    for folder in ("perception", "perception/primitives", "perception/floor"):
        files[f"{folder}/__init__.py"] = '"""Nothing."""\n'
    for name, content in files.items():
        path = tmp_path / "project" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(content)
    compiled = "perception/primitives/compiled.py"
    shutil.copy(ROOT / compiled, tmp_path / "project" / compiled)
    return tmp_path / "project"


def verdict(tree: Tree, file: str, kind: str, before: str) -> str:
    source = (tree.root / file).read_text()
    (change,) = (one for one in changes(source) if (one.kind, one.before) == (kind, before))
    return tree.tried((file, change)).verdict


def test_a_bug_is_noticed_by_the_test_that_sees_it(project, tmp_path, monkeypatch):
    tree = Tree(project, tmp_path / "place")
    area, kernel = "perception/floor/area.py", "perception/floor/sum_kernels.py"
    assert verdict(tree, area, "sign", "-height") == "killed"
    assert verdict(tree, area, "number", "5.0") == "survived"
    assert verdict(tree, kernel, "arithmetic", "one + other") == "killed"
    monkeypatch.setattr(run_mutants, "INTERPRETED", 0)  # compiled anew, not from the cache
    assert verdict(tree, kernel, "arithmetic", "one + other") == "killed"
    assert (project / area).read_text() == (tree.root / area).read_text() == AREA
    assert (project / kernel).read_text() == (tree.root / kernel).read_text() == KERNEL


def test_bugs_are_not_planted_where_a_test_fails_already(project, tmp_path):
    (project / "tests/perception/floor/test_area.py").write_text(
        "from perception.floor import area\n\n\ndef test_nothing():\n    assert area is None\n"
    )
    with pytest.raises(RuntimeError, match="must pass before"):
        verdict(Tree(project, tmp_path / "place"), "perception/floor/area.py", "sign", "-height")


def test_the_tests_of_a_module_are_those_of_its_room_and_those_that_import_it(project):
    tests = project / "tests"
    (project / "perception/floor/volume.py").write_text("from .area import area\n")
    for name in ("perception/floor/test_volume.py", "mapping/test_map.py"):
        (tests / name).parent.mkdir(exist_ok=True)
        (tests / name).write_text("from perception.floor import volume\n")
    (tests / "mapping/test_plan.py").write_text("import perception.floor.area\n")
    assert nearby_tests(project, project / "perception/floor/area.py") == [
        (0, tests / "perception/floor/test_area.py"),
        (1, tests / "mapping/test_plan.py"),
        (2, tests / "perception/floor/test_volume.py"),
    ]


def test_the_summary_has_the_interval_of_wilson():
    """Wilson's interval of 8 of 10 is 49.0 to 94.3 % (Brown, Cai, DasGupta 2001)."""
    (change, *_) = changes(AREA)
    tried = [Tried(("a.py", change), "killed")] * 8 + [Tried(("a.py", change), "survived")] * 2
    tried += [Tried(("a.py", change), "equivalent")] * 3
    assert summary(tried) == (
        "8 of 10 bugs noticed, 80 % (95 %: 49 to 94); 3 more change no result"
    )
    assert summary([]) == "no bug was tried"
