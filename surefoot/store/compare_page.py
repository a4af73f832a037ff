"""The page of a comparison: every figure with its interval, the worst cases side by side, and what was changed."""

from __future__ import annotations

import base64
import html
import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from urllib.parse import quote

import numpy as np

from mapping.io.atomic_write import atomic_path

from ..progress import Say
from ..report.experiment_page import filled, numbers_table, section
from ..results.run_folder import RunFolder
from .comparison import BETTER, MOST_CASES, SHOWN, WORSE, Comparison, Judged, shown_change
from .query import asker
from .sides import Side

WIDE, HIGH = 300, 90  # of a drawing, px
MOST_POINTS = 300  # of a curve
COLOURS = {WORSE: "var(--bad)", BETTER: "var(--good)"}
ROW = 'style="display: flex; flex-wrap: wrap; gap: 0.75rem; align-items: end; margin-bottom: 1rem"'
Curves = Mapping[str, np.ndarray]


def lines(comparison: Comparison) -> list[str]:
    """The comparison for the terminal."""
    header = ("figure", "pairs", "first", "second", "change, 95 % interval", "p", "verdict")
    rows = [header, *(_cells(one) for one in comparison.differing)]
    widths = [max(len(row[k]) for row in rows) for k in range(len(header))]
    table = [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]
    first = f"{comparison.second.name} against {comparison.first.name}: {comparison.words}"
    return [
        first,
        *(table if len(rows) > 1 else ()),
        *filter(None, [_equal(comparison), _left_out(comparison)]),
    ]


def write_page(comparisons: Sequence[Comparison], path: Path, say: Say) -> Path:
    """Write the page of some comparisons with the same first side; it loads nothing.

    Args:
        comparisons: At least one.
        path: The file; links to the runs are relative to it.
        say: What was left out of the runs.

    Raises:
        OutputError: It cannot be written.
    """
    body = [f'<p class="soft">{html.escape(_method(comparisons[0]))}</p>']
    for one in comparisons:
        if len(comparisons) > 1:
            body.append(f"<h2>{html.escape(f'{one.second.name}: {one.words}')}</h2>")
        body += [
            section("Figures", _figures(one)),
            section("Worst cases", _cases(one, path, say)),
            section("Settings that differ", _settings(one)),
            section("Code", _versions(one)),
        ]
    found = [one for each in comparisons for one in each.found]
    good = None if not found else all(one.verdict == BETTER for one in found)
    words = comparisons[0].words if len(comparisons) == 1 else f"{len(found)} differences"
    names = " and ".join(one.second.name for one in comparisons)
    page = filled(f"{names} against {comparisons[0].first.name}", good, words, body)
    with atomic_path(path) as part:
        part.write_text(page, encoding="utf-8")
    return path


def _method(one: Comparison) -> str:
    return (
        f"Pairs of runs of the same recording or seed: {len(one.pairs)}. Change: estimate of the typical "
        "paired differences (ratios where all values are positive) with its 95 % interval, which takes six pairs; of figures that should be 1, the change of their distance from 1 "
        "(a half is as far as 2). A "
        "figure is called better or worse if the signed rank test with winsorised ranks and Holm's correction over all "
        f"figures leaves less than {one.alarm:g} for chance."
    )


def _cells(one: Judged) -> tuple[str, ...]:
    chance = "" if math.isnan(one.adjusted) else f"{one.adjusted:.2g}"
    return (
        one.figure.name, str(one.difference.number), SHOWN.format(one.before), SHOWN.format(one.after), shown_change(one),
        chance, one.verdict,
    )  # fmt: skip


def _equal(comparison: Comparison) -> str:
    names = [one.figure.name for one in comparison.judged if one not in comparison.differing]
    return f"equal in every pair: {', '.join(names)}" if names else ""


def _left_out(comparison: Comparison) -> str:
    return f"not compared: {'; '.join(comparison.left_out)}" if comparison.left_out else ""


def _figures(comparison: Comparison) -> str:
    header = (
        "figure",
        "pairs",
        "first, median",
        "second, median",
        "change, 95 % interval",
        "p",
        "verdict",
    )
    rows = []
    for one in comparison.differing:
        name, *cells, change, chance, verdict = (html.escape(cell) for cell in _cells(one))
        kind = {BETTER: "good", WORSE: "bad"}.get(one.verdict, "soft")
        title = f'<span title="{html.escape(one.figure.words)}">{name}</span>'
        drawn = f"{change}<br>{_bar(one)}"
        rows.append((title, *cells, drawn, chance, f'<span class="{kind}">{verdict}</span>'))
    said = filter(None, (_equal(comparison), _left_out(comparison)))
    words = "".join(f"<p>{html.escape(one)}.</p>" for one in said)
    return (numbers_table(header, rows) if rows else "") + words


def _bar(one: Judged) -> str:
    """The interval as a bar about no change."""
    if not all(map(math.isfinite, (one.low, one.high, one.change))):
        return ""
    reach = max(abs(one.low), abs(one.high)) or 1.0
    low, high, at = (60.0 + 55.0 * value / reach for value in (one.low, one.high, one.change))
    colour = COLOURS.get(one.verdict, "var(--soft)")
    return (
        f'<svg width="120" height="14" role="img" aria-label="interval"><line x1="60" x2="60" y1="0" y2="14" '
        f'stroke="var(--line)"/><line x1="{low:.1f}" x2="{high:.1f}" y1="7" y2="7" stroke="{colour}" stroke-width="3"/>'
        f'<circle cx="{at:.1f}" cy="7" r="3.5" fill="{colour}"/></svg>'
    )


def _cases(comparison: Comparison, path: Path, say: Say) -> str:
    """The pairs with the largest losses of the first figure that became worse, or else of the first known one."""
    worse = [one for one in comparison.judged if one.verdict == WORSE and one.worst]
    chosen = next(iter([*worse, *(one for one in comparison.judged if one.worst)]), None)
    if chosen is None:
        return ""
    sides = (comparison.first, comparison.second)
    curves = [_curves(side, chosen.worst, say) for side in sides]
    shown = []
    for key in chosen.worst[:MOST_CASES]:
        values = [side.metrics[key][chosen.figure.name] for side in sides]
        words = f"{comparison.first.labels[key]}: {chosen.figure.name} {' → '.join(map(SHOWN.format, values))}"
        both = [found[key] for found in curves]
        at_s = float(both[1][np.argmax(both[1][:, 1]), 0]) if len(both[1]) else 0.0
        figures = "".join(
            _run(side, key, number, path, at_s)
            for number, side in zip(("first", "second"), sides, strict=True)
        )
        drawn = _errors(both)
        shown.append(f"<p>{html.escape(words)}</p><div {ROW}>{drawn}{figures}</div>")
    return (
        f"<p>Largest losses of {html.escape(chosen.figure.words)}. Curves: position error over time, first grey, "
        f'second blue. Pictures: at the largest error of the second.</p><div class="views">{"".join(shown)}</div>'
    )


def _curves(side: Side, keys: Sequence[str], say: Say) -> Curves:
    """Key to (stamp, position error) of its run."""
    found: dict[str, np.ndarray] = {}
    with asker([side.place], say) as tables:
        for key in keys:
            rows = tables.ask(
                "SELECT stamp_s, error_m FROM frames WHERE run = ? AND error_m IS NOT NULL ORDER BY stamp_s",
                [side.runs[key]],
            ).rows
            found[key] = np.array(rows, dtype=np.float64).reshape(-1, 2)
    return found


def _errors(curves: Sequence[np.ndarray]) -> str:
    """Position errors of both sides over time; empty without any."""
    every = np.concatenate(list(curves))
    if not len(every):
        return ""
    (left, _), (right, top) = every.min(axis=0), every.max(axis=0)
    drawn = ""
    for curve, colour in zip(curves, ("var(--soft)", "var(--belief)"), strict=True):
        few = curve[:: max(1, len(curve) // MOST_POINTS)]
        x = WIDE * (few[:, 0] - left) / max(right - left, 1e-9)
        y = HIGH - (HIGH - 14) * few[:, 1] / max(top, 1e-12)
        points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))
        drawn += f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="1.4"/>'
    label = f'<text x="0" y="10" font-size="10" fill="currentColor">to {100 * top:.3g} cm</text>'
    return f'<svg width="{WIDE}" height="{HIGH}" role="img" aria-label="position error">{drawn}{label}</svg>'


def _run(side: Side, key: str, which: str, path: Path, at_s: float) -> str:
    """The view of a run that is nearest to an instant, with a link to the report of the run."""
    run = RunFolder(side.folder(key))
    link = quote(os.path.relpath(run.path("report.html").resolve(), path.resolve().parent))
    views = [one for one in run.read_json("views.json") or [] if run.has(one["file"])]
    views.sort(key=lambda one: (one["name"] != "colour", abs(one["stamp"] - at_s)))
    image = ""
    if views:
        kind = "png" if views[0]["file"].endswith(".png") else "jpeg"
        data = base64.b64encode(run.path(views[0]["file"]).read_bytes()).decode("ascii")
        image = f'<img src="data:image/{kind};base64,{data}" alt="view of the {which} run">'
    return f'<figure style="width: 14rem">{image}<figcaption><a href="{link}">{which}: report</a></figcaption></figure>'


def _settings(comparison: Comparison) -> str:
    rows = [tuple(map(html.escape, row)) for row in comparison.settings]
    return numbers_table(("setting", "first", "second"), rows) if rows else ""


def _versions(comparison: Comparison) -> str:
    sides = (comparison.first, comparison.second)
    rows = [(html.escape(one.name), html.escape(", ".join(one.versions))) for one in sides]
    return numbers_table(("runs", "made by"), rows)
