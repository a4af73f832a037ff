"""The report of a run: one HTML page made from the files of the run folder.

All pictures are inside the page and it loads nothing from the network, so it can be sent by mail. Every kind of
run has a report: walks and recordings show trajectory, errors and decisions, maps their surface and layers,
panoramas their obstacles, monocular runs their stages. A batch has a page of its own (`batch_page`).
"""

from __future__ import annotations

import html
import shlex
from importlib import resources
from pathlib import Path
from string import Template
from typing import Any

from ..evaluation.evaluate import evaluate
from ..results.run_folder import MAP, MONOCULAR, PANORAMA, PLAYBACK, SIMULATION, RunFolder
from ..results.version import version
from .cards import cards, skipped, verdict
from .plots.pictures import pictures
from .replay.page import REPLAY, is_current, write_replay
from .sections import (
    card_item,
    figure_rows,
    panorama_section,
    plot_section,
    sessions_section,
    stages_section,
    views_section,
)

PAGE = "report.html"
FILES = {
    REPLAY: "the run moment by moment, with a time slider",
    "config.toml": "every setting of this run",
    "recording.mcap": "sensor data; Foxglove and Rerun open it",
    "estimates.mcap": "estimates and plans over time; Foxglove and Rerun open it",
    "film.webp": "moving picture of the run (`surefoot film`)",
    "trajectory.txt": "estimated poses, TUM text (evo reads it)",
    "trajectory_covariance.csv": "x, y, yaw with covariance",
    "states.csv": "tracked or lost at every instant of a robot's log, with standard deviations",
    "space_covariance.csv": "6x6 covariances of the camera poses: from the start, and after alignment",
    "tracking.csv": "state of the odometry in every frame, and the probability that its pose is wrong",
    "aligned_errors.csv": "errors after alignment with a given truth, with standard deviations",
    "mesh.ply": "surface mesh (MeshLab, CloudCompare, Open3D)",
    "layers.npz": "height, slope, step and traversability of the floor (NumPy)",
    "graph.g2o": "pose graph: keyframes, odometry and loop closures",
    "smoothed.txt": "smoothed poses, which use later measurements too (`surefoot smooth`)",
    "smoothed_covariance.csv": "the same as x, y, yaw with covariance",
    "sessions.json": "the sessions of a merged map: the part of each, and the evidence for every two",
    "changes.json": "what was moved, went or came between two sessions, with probabilities",
    "map.yaml": "occupancy grid, with map.pgm, for Nav2 / map_server",
    "map_probability.yaml": "occupancy probability of the whole run, with map_probability.png, for Nav2 (mode: scale)",
    "map_layers.tif": "occupancy, height and its variance of the whole run (QGIS, GDAL, rasterio)",
    "rooms.json": "rooms of the whole run with their areas, doorways with their widths",
    "terrain.npz": "terrain map around the robot at the end: probability, height with variance, stamps (NumPy)",
    "ground.json": "surfaces on which a foot may stand, with heights and what is beyond each side",
    "footsteps.csv": "where each foot landed, with the chances that it was claimed to miss an edge",
    "heights.csv": "height of the body above the start, with its standard deviation",
    "cloud.ply": "point cloud of the run (MeshLab, CloudCompare, Open3D)",
    "obstacles.json": "tracks over time with covariances, and footprints of static obstacles",
    "floor.csv": "floor plane of every frame and camera",
    "status.csv": "what the run doubted, and when",
    "odometry.csv": "step odometry and gyroscope",
    "sightings.csv": "landmark measurements: range and bearing with covariance",
    "commands.csv": "footsteps and gaze",
    "timing.csv": "milliseconds per stage and frame",
    "innovations.csv": "whitened innovations of landmarks and tracks",
    "panorama.json": "views, obstacles and gaps of the panorama with standard deviations",
    "panorama.npz": "range and standard deviation on the sphere (NumPy)",
    "panorama_obstacles.png": "picture of the panorama with its obstacles and gaps",
    "panorama.ply": "point cloud of the panorama (Open3D)",
    "monocular.json": "number of frames, and IoU of the floor by colour against depth",
    "stages-*.png": "the stages of the floor by colour, a picture for every frame",
    "metrics.json": "the figures of this page",
    "summary.json": "kind, frames, skipped frames, goals, command",
    "figures/map.svg": "the plots of this page as files, in figures/",
    "truth/trajectory.txt": "ground truth, used by the evaluation only, in truth/",
}
_VERBS = {MAP: "map", PANORAMA: "panorama", MONOCULAR: "monocular", PLAYBACK: "process"}


def write_report(run: RunFolder) -> Path:
    """Draw the plots into figures/ and write report.html; evaluates the run and writes replay.html first if needed.

    Returns:
        Path of the page.

    Raises:
        InputError, RecordingError: A file of the run cannot be read.
        OutputError: The page cannot be written.
    """
    kind = run.kind
    metrics = run.read_json("metrics.json")
    if metrics is None or bool(metrics.get("interrupted")) != run.interrupted:
        metrics = evaluate(run)
    summary = run.read_json("summary.json") or {}
    drawn = pictures(run)
    with run.staged() as stage:
        (stage / "figures").mkdir()
        for picture in drawn:
            (stage / "figures" / f"{picture.identity}.svg").write_bytes(picture.svg)
    if not is_current(run):
        write_replay(run)
    sections = [plot_section(picture) for picture in drawn]
    sections.insert(1, views_section(run) or stages_section(run))
    sections = [panorama_section(run), sessions_section(run), *sections]
    verdict_class, verdict_words = verdict(metrics)
    page = Template(resources.files(__package__).joinpath("report_page.html").read_text("utf-8"))
    text = page.substitute(
        title=html.escape(str(summary.get("name") or run.root.resolve().name)),
        subtitle=html.escape(_subtitle(summary, metrics, kind, run.interrupted)),
        verdict=html.escape(verdict_words),
        verdict_class=verdict_class,
        replay=f'<a href="{REPLAY}">▶ replay this run</a>' if run.has(REPLAY) else "",
        cards="\n".join(card_item(card) for card in cards(metrics, summary, kind)),
        sections="\n".join(section for section in sections if section),
        command=html.escape(_command(run, summary)),
        files="\n".join(
            f"<tr><td><code>{name}</code></td><td>{words}</td></tr>"
            for name, words in FILES.items()
            if any(run.root.glob(name))
        ),
        numbers="\n".join(figure_rows(metrics)),
    )
    return run.write_text(PAGE, text)


def _subtitle(
    summary: dict[str, Any], metrics: dict[str, Any], kind: str, interrupted: bool
) -> str:
    """Kind, duration, version, and remarks, on one line."""
    named = {SIMULATION: "simulated walk", PLAYBACK: "processed recording"}.get(kind, kind)
    format_name = summary.get("kind")
    if kind == PLAYBACK and format_name and format_name != PLAYBACK:
        named += f" ({format_name})"
    parts = [named]
    if interrupted:
        parts.append("interrupted: this is its first part")
    seconds = summary.get("seconds", metrics.get("duration_s"))
    if seconds is not None:
        parts.append(f"{float(seconds):.1f} s")
    if summary.get("renderer") and kind == SIMULATION:
        parts.append(f"renderer: {summary['renderer']}")
    parts.append(f"surefoot {summary.get('version') or version()}")
    parts += [f"skipped {count}: {reason}" for reason, count in skipped(summary).items() if count]
    parts += [str(note) for note in summary.get("notes") or []]
    parts += [str(metrics["note"])] if "note" in metrics else []
    return " · ".join(parts)


def _command(run: RunFolder, summary: dict[str, Any]) -> str:
    """Commands that repeat, evaluate and show the run."""
    folder = shlex.quote(str(run.root))
    lines = [f"surefoot evaluate {folder}", f"surefoot view {folder}"]
    again = summary.get("command")
    if not again:
        config = f" --config {shlex.quote(str(run.path('config.toml')))}"
        recording = shlex.quote(str(summary.get("recording") or "RECORDING"))
        verb = "simulate" if run.kind == SIMULATION else f"{_VERBS[run.kind]} {recording}"
        again = f"surefoot {verb}{config if run.has('config.toml') else ''}"
    return "\n".join([str(again), *lines])
