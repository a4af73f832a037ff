"""Figures in `papers.md`, taken from the results of experiments.

    surefoot experiment 000-E1 --json > result.json
    python docs/papers.py result.json

A number in the page stands behind a comment that names its experiment, figure and digits, `%` for a share in percent:
`<!--000-E1 flow_speed_share_joints .0%-->92`. What is shown is kept in `papers.json`, with seeds, version and date.
"""

from __future__ import annotations

import json
import re
import sys
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

PAGE = Path(__file__).with_suffix(".md")
KEPT = Path(__file__).with_suffix(".json")
NUMBER = re.compile(r"<!--(\S+) (\w+) (\.\d)(%?)-->(-?[\d.]*\d)")
"""Experiment, figure, digits, percent, and the number shown."""


def named(page: str) -> dict[str, set[str]]:
    """Figures of each experiment that the page shows."""
    found: dict[str, set[str]] = {}
    for identity, figure, *_ in NUMBER.findall(page):
        found.setdefault(identity, set()).add(figure)
    return found


def taken(result: dict[str, Any], figures: set[str]) -> dict[str, Any]:
    """What is kept of a result. Raises SystemExit if it lacks a figure."""
    lacking = sorted(name for name in figures if result["figures"].get(name) is None)
    if lacking:
        raise SystemExit(f"{result['id']}: the result has no {', '.join(lacking)}")
    return {
        "figures": {name: float(f"{result['figures'][name]:.6g}") for name in sorted(figures)},
        "seeds": result["seeds"],
        "version": result["version"],
        "date": datetime.now(UTC).date().isoformat(),
    }


def filled(page: str, kept: dict[str, dict[str, Any]]) -> str:
    """The page with the kept figures."""

    def shown(match: re.Match[str]) -> str:
        identity, figure, digits, percent, _ = match.groups()
        value = kept[identity]["figures"][figure] * (100.0 if percent else 1.0)
        return f"<!--{identity} {figure} {digits}{percent}-->{value:{digits}f}"

    return NUMBER.sub(shown, page)


def main(files: list[str]) -> None:
    """Take the figures of these results into the page."""
    page, kept = PAGE.read_text(encoding="utf-8"), json.loads(KEPT.read_text(encoding="utf-8"))
    figures = named(page)
    for file in files:
        result = json.loads(Path(file).read_text(encoding="utf-8"))
        if result["id"] not in figures:
            raise SystemExit(f"{file}: {PAGE.name} shows no figure of {result['id']}")
        kept[result["id"]] = taken(result, figures[result["id"]])
    KEPT.write_text(json.dumps(dict(sorted(kept.items())), indent=1) + "\n", encoding="utf-8")
    PAGE.write_text(filled(page, kept), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
