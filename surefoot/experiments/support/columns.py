"""The table of an experiment on a paper's method: published number, published method as we run it, ours."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

NOT_PRINTED = "none printed"

Row = tuple[str, float | None, str, str]
"""What is compared, the number of the paper (None: it prints none), and the names of the figure by the published
method and by ours; a name that is not among the figures gives nan, an empty one a dash."""


def three_columns(figures: Mapping[str, float], rows: Sequence[Row]) -> list[str]:
    """Lines of a table with three columns; `figures` is name to value."""
    lines = [f"{'':<38}{'paper':>14}{'its method here':>17}{'ours':>12}"]
    for words, paper, published, ours in rows:
        printed = NOT_PRINTED if paper is None else f"{paper:.4g}"
        one, other = (f"{figures.get(k, math.nan):.4g}" if k else "-" for k in (published, ours))
        lines.append(f"{words:<38}{printed:>14}{one:>17}{other:>12}")
    return lines
