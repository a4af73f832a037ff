"""LaTeX tables: whatever stands in a name or title is printed as it stands, and every row has all its cells."""

from __future__ import annotations

import re
import shutil
import subprocess

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from surefoot.results import latex

NASTY = r"50% of a_b & c#1 $x$ {y} \z ~t^2 <d> |e| fi--ff `q' \"u\" ü ψ"
RESULT = {
    "id": "00_1%",
    "title": NASTY,
    "seeds": 3,
    "version": "1_0",
    "figures": {"a_share": 0.25, "tiny_m": 1.5e-7, "none": None, "its_a": 2.0},
    "targets": {"a_share": [">=", 0.5], "none": ["==", 1.0]},
    "published": {"a_share": 0.75},
    "intervals": {"a_share": [0.2, 0.3]},
    "columns": [["50 % & more", None, "its_a", "a_share"], ["x", 1.0, "", "tiny_m"]],
}


@settings(max_examples=60, deadline=None)
@given(st.text())
def test_no_letter_keeps_a_meaning_of_its_own_in_latex(text):
    left = re.sub(r"\\(?:[{}$&#%_]|text[a-z]+\{\})|\{-\}", "", latex.escaped(text))
    assert not re.search(r"[\\{}$&#%_~^<>|\"`-]", left)


@pytest.mark.parametrize(
    ("value", "shown"),
    [(0.25, "$0.25$"), (1.5e-7, r"$1.5 \cdot 10^{-7}$"), (-2e12, r"$-2 \cdot 10^{12}$"), (None, "--"), (float("inf"), r"$\infty$")],
)  # fmt: skip
def test_numbers_are_set_as_mathematics(value, shown):
    assert latex.number(value) == shown


def test_every_row_of_a_table_has_a_cell_for_each_column():
    text = latex.table(RESULT)
    for form, body in re.findall(r"\\begin\{tabular\}\{(\w+)\}(.*?)\\end\{tabular\}", text, re.DOTALL):  # fmt: skip
        rows = [line for line in body.splitlines() if line.endswith(r"\\")]
        assert len(rows) >= 3
        assert {len(re.findall(r"(?<!\\)&", row)) + 1 for row in rows} == {len(form)}
    assert r"a\_share & $0.75$ & $0.25$ & $0.2$ to $0.3$ & $\geq$ $0.5$ \\" in text


@pytest.mark.skipif(shutil.which("pdflatex") is None, reason="pdflatex is not installed")
def test_the_table_compiles(tmp_path):
    (tmp_path / "t.tex").write_text(
        "\\documentclass{article}\\usepackage[T1]{fontenc}\\usepackage{booktabs}\\begin{document}"
        + latex.table(RESULT)
        + "\\end{document}"
    )
    done = subprocess.run(
        ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", "t.tex"], cwd=tmp_path, capture_output=True
    )  # fmt: skip
    assert done.returncode == 0, done.stdout[-2000:]
