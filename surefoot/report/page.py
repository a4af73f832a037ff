"""The report of a run: one page that stands alone, made from the files of the run folder only.

Pictures are inside the page, and nothing is fetched from anywhere, so that it can be sent by mail and
opened in ten years.
"""

from __future__ import annotations

import base64
import html
import math
import shlex
from dataclasses import dataclass
from importlib import metadata, resources
from pathlib import Path
from string import Template
from typing import Any

from ..evaluation.evaluate import evaluate
from ..evaluation.targets import verdicts
from ..results.run_folder import RunFolder
from .plots.time_series import Picture, pictures

PAGE = "report.html"
FILES = {
    "config.toml": "every setting of this run",
    "recording.mcap": "what the sensors said; opens in Foxglove and Rerun",
    "trajectory.txt": "where the body believed to be, TUM text (evo reads it)",
    "trajectory_covariance.csv": "the same as x, y, yaw with covariance",
    "space_covariance.csv": "six degrees of freedom: since the start, and after alignment of the whole way",
    "aligned_errors.csv": "what a given truth leaves after alignment, beside what was claimed",
    "mesh.ply": "the surface (MeshLab, CloudCompare, Open3D)",
    "layers.npz": "height, slope, step and traversability of the floor (NumPy)",
    "graph.g2o": "references, steps and places known again, as a pose graph",
    "smoothed.txt": "the same way, every pose knowing what came after it (`surefoot smooth`)",
    "map.yaml": "the grid, with map.pgm, for Nav2 / map_server",
    "terrain.npz": "the terrain map round the robot at the end: probability, height with variance, stamps (NumPy)",
    "cloud.ply": "points of the run (MeshLab, CloudCompare, Open3D)",
    "obstacles.json": "tracks over time with covariances, and footprints of what stands",
    "floor.csv": "the floor plane of every frame and camera",
    "odometry.csv": "steps and inertial sensor as the filter took them",
    "sightings.csv": "landmarks, range and bearing with covariance",
    "commands.csv": "footsteps and gaze",
    "timing.csv": "milliseconds per stage and frame",
    "innovations.csv": "surprise of every sighting of a landmark or a track, whitened",
    "metrics.json": "the figures of this page",
    "summary.json": "frames, skipped frames, goals, renderer",
    "figures/map.svg": "the pictures of this page, one by one, in figures/",
    "truth/trajectory.txt": "what was true, for evaluation only, in truth/",
}


@dataclass(frozen=True)
class Card:
    """One number at the top of the page; `met` is None where nothing is asked of it."""

    name: str
    value: str
    note: str
    met: bool | None = None


def write_report(run: RunFolder) -> Path:
    """Draw the pictures into figures/ and write report.html; measures first if nobody has yet.

    Returns:
        Where the page is.

    Raises:
        InputError, RecordingError: A file of the run cannot be read.
        OutputError: The page cannot be written.
    """
    metrics = run.read_json("metrics.json")
    if metrics is None:
        metrics = evaluate(run)
    summary = run.read_json("summary.json") or {}
    drawn = pictures(run)
    with run.staged() as stage:
        (stage / "figures").mkdir()
        for picture in drawn:
            (stage / "figures" / f"{picture.identity}.svg").write_bytes(picture.svg)
    verdict_class, verdict = _verdict(metrics)
    sections = [_section(picture) for picture in drawn]
    sections.insert(1, _views(run))
    page = Template(resources.files(__package__).joinpath("report_page.html").read_text("utf-8"))
    text = page.substitute(
        title=html.escape(str(summary.get("name") or run.root.resolve().name)),
        subtitle=html.escape(_subtitle(summary, metrics)),
        verdict=html.escape(verdict),
        verdict_class=verdict_class,
        cards="\n".join(_card(card) for card in cards(metrics, summary)),
        sections="\n".join(section for section in sections if section),
        command=html.escape(_command(run, summary)),
        files="\n".join(
            f"<tr><td><code>{name}</code></td><td>{told}</td></tr>"
            for name, told in FILES.items()
            if run.has(name)
        ),
        numbers="\n".join(_rows(metrics)),
    )
    return run.write_text(PAGE, text)


def cards(metrics: dict[str, Any], summary: dict[str, Any]) -> list[Card]:
    """The numbers at the top, as far as they are known."""
    met = {target.figure: good for target, _, good in verdicts(metrics)}
    listed = []

    def add(figure: str, name: str, shown: str, note: str, judged_by: str = "") -> None:
        value = metrics.get(figure)
        if value is not None:
            listed.append(Card(name, shown.format(value), note, met.get(judged_by or figure)))

    scaled = {
        "position_cm": 100 * metrics.get("position_rmse_m", float("nan")),
        "clearance_cm": 100 * metrics.get("min_clearance_m", float("nan")),
    }
    if "position_rmse_m" in metrics:
        shown = f"{scaled['position_cm']:.1f} cm"
        note = "RMS on the floor; at most 5 cm"
        listed.append(Card("Position error", shown, note, met.get("position_rmse_m")))
    add("heading_rmse_deg", "Heading error", "{:.2f}°", "RMS; at most 2°")
    if "position_rmse_m" not in metrics:
        add("ate_aligned_m", "Way after alignment", "{:.3f} m", "RMS in space (ATE)")
    add("surface_fscore_2cm", "Surface, F-score", "{:.1%}", "at 2 cm")
    add(
        "pose_anees", "Mean NEES of the pose", "{:.2f}",
        f"honest: {metrics.get('pose_anees_low') or 0:.2f} to {metrics.get('pose_anees_high') or 0:.2f}",
        "pose_consistent",
    )  # fmt: skip
    one_cell = metrics.get("grid_correct_share_one_cell")
    note = "at least 95 %" + (f"; {one_cell:.1%} within one cell" if one_cell is not None else "")
    add("grid_correct_share", "Seen cells right", "{:.1%}", note)
    add("floor_tof_angle_deg_median", "Floor tilt error", "{:.2f}°", "TOF, median; at most 0.5°")
    add(
        "floor_tof_height_mm_median", "Floor height error", "{:.1f} mm", "TOF, median; at most 5 mm"
    )
    if "floor_tof_angle_deg_median" not in metrics:
        for camera in ("tof", "depth", "stereo"):
            add(f"floor_{camera}_seen_share", f"Floor seen ({camera})", "{:.0%}", "of the frames")
    if "min_clearance_m" in metrics:
        count = int(metrics.get("contacts", 0))
        note = "no contact" if count == 0 else f"{count} contact" + ("s" if count > 1 else "")
        shown = f"{scaled['clearance_cm']:.1f} cm"
        listed.append(Card("Smallest clearance", shown, note, met.get("contacts")))
    if "goals_passed" in metrics:
        shown = f"{metrics['goals_passed']:.0f} of {metrics['goals']:.0f}"
        note = f"stopped {metrics['goal_final_m']:.2f} m from the last"
        listed.append(Card("Goals reached", shown, note, met.get("goals_missed")))
    add("falls", "Falls", "{:.0f}", "a fall ends the run")
    add("path_m", "Way", "{:.2f} m", f"in {metrics.get('duration_s') or 0:.0f} s")
    total = (metrics.get("timing_ms") or {}).get("total")
    if total:
        note = f"median; 95 % under {total['p95']:.0f} ms"
        listed.append(Card("Time per frame", f"{total['p50']:.0f} ms", note))
    skipped = sum((summary.get("skipped") or {}).values())
    if "frames" in summary:
        note = "none skipped" if skipped == 0 else f"{skipped} skipped"
        listed.append(Card("Frames", str(summary["frames"]), note))
    return listed


def _verdict(metrics: dict[str, Any]) -> tuple[str, str]:
    judged = verdicts(metrics)
    if not judged:
        return "none", "no truth to judge it by"
    good = sum(met for _, _, met in judged)
    text = f"{good} of {len(judged)} targets met"
    return ("good" if good == len(judged) else "bad"), text


def _subtitle(summary: dict[str, Any], metrics: dict[str, Any]) -> str:
    said = []
    if summary.get("kind"):
        kind = summary["kind"]
        said.append("live run in simulation" if kind == "simulation" else f"recording ({kind})")
    seconds = summary.get("seconds", metrics.get("duration_s"))
    if seconds is not None:
        said.append(f"{float(seconds):.1f} s")
    if summary.get("renderer") and summary.get("kind") == "simulation":
        said.append(f"renderer: {summary['renderer']}")
    said.append(f"surefoot {summary.get('version') or _version()}")
    said += [
        f"skipped {count}: {reason}" for reason, count in (summary.get("skipped") or {}).items()
    ]
    said += [str(note) for note in summary.get("notes") or []]
    return " · ".join(said)


def _version() -> str:
    try:
        return metadata.version("surefoot")
    except metadata.PackageNotFoundError:
        return "from source"


def _card(card: Card) -> str:
    mark = {None: "", True: '<b class="good">✓ met</b> · ', False: '<b class="bad">✗ missed</b> · '}
    return (
        f'<li><span class="name">{html.escape(card.name)}</span>'
        f'<span class="value">{html.escape(card.value)}</span>'
        f'<span class="note">{mark[card.met]}{html.escape(card.note)}</span></li>'
    )


def _section(picture: Picture) -> str:
    data = base64.b64encode(picture.svg).decode("ascii")
    return (
        f'<section id="{picture.identity}">\n<h2>{html.escape(picture.title)}</h2>\n'
        f"<p>{html.escape(picture.sentence)}</p>\n"
        f'<figure class="plot"><img alt="{html.escape(picture.title)}" '
        f'src="data:image/svg+xml;base64,{data}"></figure>\n</section>'
    )


def _views(run: RunFolder) -> str:
    """The camera views, one instant at a time; without scripts all of them one below the other."""
    shots: dict[float, list[str]] = {}
    start = math.inf
    for view in run.read_json("views.json") or []:
        if not run.has(view["file"]):
            continue
        kind = "png" if str(view["file"]).endswith(".png") else "jpeg"
        data = base64.b64encode(run.path(view["file"]).read_bytes()).decode("ascii")
        start = min(start, float(view["stamp"]))
        caption = html.escape(f"{view['name']}, {float(view['stamp']) - start:.1f} s")
        shots.setdefault(float(view["stamp"]), []).append(
            f'<figure><img alt="{caption}" src="data:image/{kind};base64,{data}">'
            f"<figcaption>{caption}</figcaption></figure>"
        )
    if not shots:
        return ""
    listed = "\n".join(
        f'<div class="shot" data-told="{stamp - start:.1f} s">{"".join(figures)}</div>'
        for stamp, figures in sorted(shots.items())
    )
    return (
        '<section id="views" class="views">\n<h2>What it saw</h2>\n'
        "<p>The camera views along the way; in depth pictures near is bright and black is no answer.</p>\n"
        '<div class="slider"><input id="instant" type="range" min="0" '
        f'max="{len(shots) - 1}" value="0" aria-label="instant">'
        f'<output id="told" for="instant"></output></div>\n{listed}\n</section>'
    )


def _command(run: RunFolder, summary: dict[str, Any]) -> str:
    folder = shlex.quote(str(run.root))
    config = shlex.quote(str(run.root / "config.toml"))
    again = summary.get("command")
    if not again:
        recording = shlex.quote(str(summary.get("recording") or "RECORDING"))
        verb = "simulate" if summary.get("kind") == "simulation" else f"process {recording}"
        again = f"surefoot {verb} --config {config}"
    return f"{again}\nsurefoot evaluate {folder}\nsurefoot view {folder}"


def _rows(metrics: dict[str, Any]) -> list[str]:
    rows = []
    for name, value in metrics.items():
        if name == "timing_ms":
            rows += [
                f"<tr><td><code>{name}.{html.escape(stage)}</code></td>"
                f'<td class="number">{t["p50"]:.2f} / {t["p95"]:.2f} / {t["max"]:.2f}</td></tr>'
                for stage, t in value.items()
            ]
            continue
        shown = str(value).lower() if isinstance(value, bool) else "none"
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            shown = f"{value:.6g}"
        rows.append(
            f'<tr><td><code>{html.escape(name)}</code></td><td class="number">{shown}</td></tr>'
        )
    return rows
