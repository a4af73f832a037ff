"""The result of an experiment as a LaTeX table.

Source: ours; the style is that of the package booktabs.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

_SPECIAL = {
    "\\": r"\textbackslash{}", "{": r"\{", "}": r"\}", "$": r"\$", "&": r"\&", "#": r"\#", "%": r"\%",
    "_": r"\_", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "<": r"\textless{}",
    ">": r"\textgreater{}", "|": r"\textbar{}", '"': r"\textquotedbl{}", "-": "{-}", "`": r"\textasciigrave{}",
}  # fmt: skip
_RELATIONS = {"<=": r"$\leq$", ">=": r"$\geq$", "<": "$<$", ">": "$>$", "==": "$=$"}


def escaped(text: str) -> str:
    """Text that LaTeX prints as it stands; what pdfLaTeX has no letter for becomes a question mark."""
    plain = text.encode("latin-1", "replace").decode("latin-1")
    return "".join(_SPECIAL.get(letter, letter) for letter in plain)


def number(value: float | None) -> str:
    """A number with four significant digits in mathematics; a dash for none."""
    if value is None or math.isnan(value):
        return "--"
    if math.isinf(value):
        return r"$\infty$" if value > 0 else r"$-\infty$"
    digits, _, power = f"{value:.4g}".partition("e")
    return f"${digits}$" if not power else f"${digits} \\cdot 10^{{{int(power)}}}$"


def table(result: Mapping[str, Any]) -> str:
    """A `table` with booktabs rules: every figure with its interval, target and published number.

    The rows of the comparison with the published method come first, if the experiment has any.

    Args:
        result: Content of result.json.
    """
    title, seeds = escaped(f"{result['id']}: {result['title']}"), result["seeds"]
    lines = [
        r"% \usepackage{booktabs}",
        r"\begin{table}",
        r"\centering\small",
        rf"\caption{{{title}. Seeds: {seeds}. Surefoot {escaped(result['version'])}.}}",
        rf"\label{{tab:{''.join(c if c.isalnum() else '-' for c in result['id'])}}}",
    ]
    figures = result["figures"]
    if result["columns"]:
        rows = [
            [escaped(words.strip()), number(paper), *(number(figures.get(k)) for k in names)]
            for words, paper, *names in result["columns"]
        ]
        lines += _tabular(["", "paper", "its method here", "ours"], rows)
        lines.append(r"\par\medskip")
    rows = []
    for name, value in figures.items():
        low, high = result["intervals"].get(name, (None, None))
        relation, bound = result["targets"].get(name, ("", None))
        target = "" if bound is None else f"{_RELATIONS[relation]} {number(bound)}"
        span = "" if low is None else f"{number(low)} to {number(high)}"
        paper = number(result["published"][name]) if name in result["published"] else ""
        rows.append([escaped(name), paper, number(value), span, target])
    lines += _tabular(["figure", "paper", "ours", r"95\,\% interval", "target"], rows)
    return "\n".join([*lines, r"\end{table}", ""])


def _tabular(header: list[str], rows: list[list[str]]) -> list[str]:
    form = "l" + "r" * (len(header) - 1)
    return [
        rf"\begin{{tabular}}{{{form}}}",
        r"\toprule",
        " & ".join(header) + r" \\",
        r"\midrule",
        *(" & ".join(row) + r" \\" for row in rows),
        r"\bottomrule",
        r"\end{tabular}",
    ]
