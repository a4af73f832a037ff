"""The page of a batch: one row for every recording, the unusual ones first.

How unusual a run is: the largest of the distances of its figures from the median over the batch, in robust standard
deviations (1.4826 times the median absolute deviation; where that is zero, 1.2533 times the mean absolute deviation), each
in the direction that is bad. Of NIS it is the logarithm that counts, up or down: 1 is consistent.

Source: the robust z-score of Iglewicz and Hoaglin 1993, "How to detect and handle outliers"; the choice of figures is ours.
"""

from __future__ import annotations

import base64
import html
import math
import re
from collections.abc import Mapping, Sequence
from importlib import resources
from string import Template
from typing import Any, NamedTuple
from urllib.parse import quote

import numpy as np

INDEX = "index.html"
ORDER = {"quarantined": 0, "failed": 1, "done": 2, "waiting": 3}
LEAST_SPREAD = 0.01  # ours: of the median; figures that are closer together are no outliers
FEWEST = 3  # ours: runs that know a figure, from which on one of them can be unusual
UNUSUAL = 3.5  # robust standard deviations from which Iglewicz and Hoaglin call a value an outlier


class Column(NamedTuple):
    """A column: key, heading, format, scale of the shown value, sign of what is bad (0: neither), whether 1 is best."""

    key: str
    heading: str
    shown: str = "{:.0f}"
    scale: float = 1.0
    bad: int = 0
    one_is_best: bool = False


COLUMNS = (
    Column("frames", "frames"),
    Column("skipped", "skipped", bad=1),
    Column("seconds", "length, s", "{:.1f}"),
    Column("floor_share", "floor seen, %", "{:.0f}", 100.0, -1),
    Column("tilt_sigma_deg", "σ of tilt, deg", "{:.3f}", 1.0, 1),
    Column("position_rmse_m", "position RMSE, mm", "{:.1f}", 1000.0, 1),
    Column("ate_m", "ATE, mm", "{:.1f}", 1000.0, 1),
    Column("landmark_nis", "NIS, landmarks", "{:.2f}", 1.0, 1, True),
    Column("track_nis", "NIS, tracks", "{:.2f}", 1.0, 1, True),
    Column("false_movers", "false movers", "{:.0f}", 1.0, 1),
    Column("wall_s", "time, s", "{:.1f}"),
)


def page(title: str, verdict: str, rows: Sequence[Mapping[str, Any]]) -> str:
    """The page as HTML.

    Args:
        title: Heading.
        verdict: How many are done, in words.
        rows: By name the figures of `COLUMNS`, and name, recording, status, reason, link, picture (WebP or empty).
    """
    unusual = unusualness(rows)
    rank = np.nan_to_num(unusual)
    by_rank = sorted(range(len(rows)), key=lambda k: (ORDER[rows[k]["status"]], -rank[k]))
    kept = [c for c in COLUMNS if any(row.get(c.key) is not None for row in rows)]
    room = resources.files(__package__)
    style = re.search(r"<style>\n(.*?)</style>", room.joinpath("report_page.html").read_text("utf-8"), re.DOTALL)  # fmt: skip
    assert style is not None, "the report of a run has a style"
    good = all(row["status"] == "done" for row in rows)
    names = ["run", "status", *(c.heading for c in kept), "unusual", "remark"]
    text = [True, True, *(False for _ in kept), False, True]
    head = "".join(
        f'<th scope="col" class="{"" if word else "number"}"><button>{html.escape(name)}</button></th>'
        for name, word in zip(names, text, strict=True)
    )
    return Template(room.joinpath("batch_page.html").read_text("utf-8")).substitute(
        title=html.escape(title),
        style=style[1],
        verdict=html.escape(verdict),
        verdict_class="good" if good else "bad",
        unusual=f"{UNUSUAL:g}",
        head=head,
        rows="\n".join(_row(rows[k], unusual[k], kept) for k in by_rank),
    )


def unusualness(rows: Sequence[Mapping[str, Any]]) -> list[float]:
    """How unusual each row is, in robust standard deviations; NaN for one without figures that three rows know."""
    worst = np.full(len(rows), math.nan)
    for column in COLUMNS:
        known = [row.get(column.key) for row in rows]
        values = np.array([math.nan if one is None else one for one in known], dtype=np.float64)
        if not column.bad or np.isfinite(values).sum() < FEWEST:
            continue
        if column.one_is_best:
            values = np.abs(np.log(np.maximum(values, 1e-9)))
        middle = float(np.nanmedian(values))
        apart = np.abs(values - middle)
        spread = 1.4826 * np.nanmedian(apart) or 1.2533 * np.nanmean(apart)
        spread = max(float(spread), LEAST_SPREAD * abs(middle), 1e-9)
        worst = np.fmax(worst, np.maximum(column.bad * (values - middle) / spread, 0.0))
    return np.minimum(worst, 999.0).tolist()


def _row(row: Mapping[str, Any], unusual: float, columns: Sequence[Column]) -> str:
    picture = base64.b64encode(row["picture"]).decode("ascii")
    image = (
        f'<img loading="lazy" decoding="async" alt="" src="data:image/webp;base64,{picture}">'
        if picture
        else ""
    )
    name = html.escape(row["name"])
    linked = (
        f'<a href="{quote(row["link"])}">{image}{name}</a>' if row["link"] else f"<div>{name}</div>"
    )
    cells = [
        f'<td title="{html.escape(row["recording"])}">{linked}</td>',
        f'<td class="{row["status"]}">{row["status"]}</td>',
        *(_number(row.get(c.key), c.shown, c.scale) for c in columns),
        _number(unusual if row["status"] == "done" else None, "{:.1f}", 1.0, unusual >= UNUSUAL),
        f"<td>{html.escape(row['reason'])}</td>",
    ]
    return f"<tr>{''.join(cells)}</tr>"


def _number(value: float | int | None, shown: str, scale: float, marked: bool = False) -> str:
    text = "" if value is None or math.isnan(value) else shown.format(scale * value)
    return f'<td class="number{" bad" if marked else ""}">{text}</td>'
