"""The replay page of a run, from its estimates.mcap and the other files of its folder.

All data are inside the page: JSON and arrays compressed, pictures as they are. A content security policy forbids every
request. If the page is too large, it holds every second picture, every third, and so on.
"""

from __future__ import annotations

import base64
import hashlib
import html
import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from importlib import resources
from pathlib import Path
from string import Template
from typing import Any

from ...results.moment import Moment
from ...results.moments import ESTIMATES, read_moments
from ...results.run_folder import MAP, MONOCULAR, PANORAMA, SIMULATION, RunFolder
from ...words import count_of
from .columns import columns, gaze_maps, grids, packed
from .figures import figures
from .gathering import Gathered, Strip, gather
from .still import still
from .strips import extra_strips
from .surroundings import surroundings

REPLAY = "replay.html"
LARGEST_BYTES = 12_000_000  # what a mail server or a phone still takes
SCRIPTS = (
    "data.js", "live.js", "ground.js", "top_view.js", "panes.js", "plots.js", "shapes.js", "scene.js", "space.js", "player.js",
)  # fmt: skip
NUMBERED = {PANORAMA: "view"}  # kinds whose moments have no common clock
_FINISHED = {
    "attributes": "", "connect": "'none'", "link": '<a href="report.html">report of this run</a>', "what": "replay",
    "fastest": "", "usual": " selected", "hidden": " hidden",
}  # fmt: skip
_LIVE = {
    "attributes": " data-live", "connect": "'self'", "link": "", "what": "live",
    "fastest": '<option value="0" id="fastest" selected>as it comes</option>', "usual": "", "hidden": "",
}  # fmt: skip
_SHOWN = {
    MAP: "The camera moves through the finished map as it was recorded",
    PANORAMA: "The views of the panorama, one after the other, over the obstacles and gaps found in all of them",
    MONOCULAR: "The frames with the stages by which floor and obstacles were found by colour",
}


def is_current(run: RunFolder) -> bool:
    """Whether the page is there and newer than the moments that it shows, or there are none."""
    if not run.has(ESTIMATES):
        return True
    page, estimates = run.path(REPLAY), run.path(ESTIMATES)
    return page.is_file() and page.stat().st_mtime_ns >= estimates.stat().st_mtime_ns


def write_replay(run: RunFolder) -> Path | None:
    """Write replay.html.

    Returns:
        Path of the page; None where the run has no moments.

    Raises:
        RecordingError: estimates.mcap is damaged.
        OutputError: The page cannot be written.
    """
    if not run.has(ESTIMATES):
        return None
    text = replay_page(run, read_moments(run))
    return None if text is None else run.write_text(REPLAY, text)


def replay_page(run: RunFolder, moments: Iterable[Moment]) -> str | None:
    """The page of the moments of a run; None without any."""
    found = gather(moments)
    if not found.moments:
        return None
    kind = run.kind
    found.strips += extra_strips(run, found.moments)
    values, series = figures(found.moments, found.grids)
    entries, cloud = surroundings(run, found.moments)
    gaze, gaze_bytes = gaze_maps(found.moments)
    grid, grid_bytes = grids(found.grids)
    content: dict[str, Any] = {
        **columns(found.moments),
        **entries,
        "values": values,
        "series": series,
        "gaze_map": gaze,
        "grid": grid,
        "by_number": NUMBERED.get(kind),
    }
    if kind in NUMBERED:
        content["t"] = [float(k) for k in range(len(found.moments))]
    summary = run.read_json("summary.json") or {}
    parts = {
        **_FINISHED,
        "title": html.escape(str(summary.get("name") or run.root.resolve().name)),
        "subtitle": html.escape(_subtitle(found, kind)),
        "missing": _missing(found, kind),
    }
    arrays = {"grid": _base64(grid_bytes), "cloud": _base64(cloud), "gaze_map": _base64(gaze_bytes)}
    every = _every(found.strips, content, arrays)
    while True:
        strips = [_thinned(strip, every) for strip in found.strips]
        content["panes"] = [strip.pane() for strip in strips]
        pictures = [[_base64(shot.data) for shot in strip.shots] for strip in strips]
        data = {"run": _compressed(content), "pictures": pictures, **arrays}
        words = still(run, found.moments, strips)
        text = _filled({**parts, "data": json.dumps(data), "still": words})
        if len(text) <= LARGEST_BYTES or all(len(strip.shots) <= 1 for strip in strips):
            return text
        every += 1


def live_page() -> str:
    """The same page without moments; it asks the program that serves it for them."""
    parts = {
        **_LIVE,
        "title": "Surefoot",
        "subtitle": "",
        "missing": "",
        "data": "",
        "still": "<p>Waiting for the first moment of the run. This page needs a browser that runs scripts.</p>",
    }
    return _filled(parts)


def _filled(parts: dict[str, str]) -> str:
    """The page with its style and script."""
    files = resources.files(__package__)
    script = '"use strict";\n' + "\n".join(
        files.joinpath(name).read_text("utf-8") for name in SCRIPTS
    )
    common = {
        "script": script,
        "script_hash": "sha256-" + _base64(hashlib.sha256(f"\n{script}\n".encode()).digest()),
        "style": files.joinpath("page.css").read_text("utf-8"),
    }
    return Template(files.joinpath("page.html").read_text("utf-8")).substitute(common | parts)


def _every(strips: Sequence[Strip], content: dict[str, Any], arrays: dict[str, str]) -> int:
    """About which share of the pictures the page can hold: every 1st, 2nd, ..."""
    room = LARGEST_BYTES - len(_compressed(content)) - sum(map(len, arrays.values()))
    pictures = sum(len(shot.data) * 4 // 3 for strip in strips for shot in strip.shots)
    return max(1, math.ceil(pictures / max(room, 1)))


def _compressed(content: dict[str, Any]) -> str:
    text = json.dumps(content, separators=(",", ":"), allow_nan=False)
    return _base64(packed(text.encode()))


def _thinned(strip: Strip, every: int) -> Strip:
    return replace(strip, shots=strip.shots[::every], labels=strip.labels[::every])


def _base64(data: bytes) -> str:
    return base64.b64encode(data).decode("ascii")


def _subtitle(found: Gathered, kind: str) -> str:
    seconds = found.moments[-1].stamp_s - found.moments[0].stamp_s
    named = {SIMULATION: "simulated walk"}.get(kind, "processed recording")
    shown = _SHOWN.get(kind, f"What this {named} knew at each moment, over the map of its end")
    told = count_of(len(found.moments), NUMBERED.get(kind, "moment"))
    return f"{shown}: {told}." if kind in NUMBERED else f"{shown}: {told} in {seconds:.1f} s."


def _missing(found: Gathered, kind: str) -> str:
    """A sentence on what the run never had, in place of empty panes."""
    moments = found.moments
    had = {
        "pose of a body": any(one.pose is not None for one in moments),
        "camera pose": any(one.cameras for one in moments),
        "camera pictures": any(strip.step_m is None for strip in found.strips),
        "depth": any(strip.step_m is not None for strip in found.strips),
        "grid around the robot": bool(found.grids),
        "tracked obstacles": any(one.tracks for one in moments),
        "plan (route, steps, gaze, risk)": any(one.why for one in moments),
    }
    missing = [name for name, there in had.items() if not there]
    if kind != SIMULATION and not had["plan (route, steps, gaze, risk)"]:
        missing[-1] += ", which only a live walk has"
    if not missing:
        return ""
    return f'<p class="soft">Not in this run: {html.escape("; ".join(missing))}.</p>'
