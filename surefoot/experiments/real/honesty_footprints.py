"""Footprints of real recordings against the saved map: none may lie over a cell that the map says is free.

Computed from the files of a finished run alone, map.yaml with map.pgm and obstacles.json, as a user of them would.

Source: ours.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from ...evaluation.footprints import footprint_figures
from ...results.run_folder import RunFolder
from ..support.experiment import Say


def part(runs: Mapping[str, Path], say: Say) -> tuple[dict[str, float], list[str]]:
    """Share of the area of all footprints over free cells, of every run and the largest.

    Args:
        runs: Name of each recording and the folder of its run by `process`.
        say: Progress.
    """
    figures, rows = {}, []
    for name, folder in runs.items():
        found = footprint_figures(RunFolder.open(folder), None)
        share = found.get("footprints_over_free_share", 0.0)
        figures[f"footprints_over_free_share_{name}"] = share
        rows.append(
            f"{name:<24} {found.get('footprints', 0.0):3.0f} footprints, {100 * share:.3f} % over free cells"
        )
    say(f"footprints: {len(rows)} recordings")
    return {"footprints_over_free_share": max(figures.values(), default=0.0)} | figures, rows
