"""An hour's walk through a building of twenty rooms, on simulated sensors alone.

The robot walks round tours through all rooms; it sees the whole building in the first half of the walk and the same rooms
again in the second. What a frame costs and what the process remembers must then depend on the area, not on the time:

- `cycle_p99_ratio`: 99th percentile of the wall time of perception and decision in the last ten minutes by that in the
  first ten without their first minute, which loads libraries; `busy_p99_ratio`: the same of their processor time, which
  others on the machine change less;
- `rss_growth_mb`: median resident memory in the last ten minutes less that in the fourth ten minutes, when the first tour
  is over; the estimates go to disk meanwhile, as in every run;
- position error and NEES of the pose (x, y, yaw) over all frames. The landmarks are known, as in the flat, so drift ends at
  the next one. The band of the mean NEES counts what is constant in a walk as one sample;
- rooms: of the true rooms of which half was seen, the share that the map shows as one room with an intersection over union
  of at least a half, the mean of it over the cells that the map shows free, the number of rooms too many, and the root mean
  square error of the widths of doorways.

Parts of ten minutes are sixths of a shorter walk. The stereo camera is off, which halves the time: the time-of-flight camera
sees the floor, the colour camera the tags. Source: ours.
"""

from __future__ import annotations

import math
import tempfile
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
from jaxtyping import Bool, Float

from mapping.io import geotiff, world_file
from perception.filtering.consistency import band
from sim.scene import Scene
from sim.scenes import catalogue

from ...config.presets import on_body
from ...config.schema import Config
from ...evaluation.evaluate import pose_errors
from ...evaluation.metrics.averages import mean, percentile, rms
from ...evaluation.metrics.consistency import consistency_metrics, squared
from ...evaluation.metrics.contacts import contact_metrics, walk_metrics
from ...evaluation.metrics.trajectory import trajectory_metrics
from ...report.plots.rooms import rooms
from ...report.plots.style import ESTIMATE, TARGET, WRONG, Drawing, sheet, styled
from ...results.room_entries import ROOMS
from ...results.run_folder import RunFolder
from ..support.experiment import Experiment, Outcome, Say, Target
from ..support.long_walk import PARTS, WalkLog, long_walk, read_log

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MINUTES = 60.0
SETTLED = 3  # number, from 0, of the ten minutes that follow the first tour
NEAR_DOOR_M = 0.3  # ours: a doorway this near to a true one is that
WINDOW = 200  # cycles of a point of the curves; a minute

LEAST = (
    "minutes", "path_m", "goals_reached", "anees_low", "anees_in_band", "rooms_seen", "rooms_found_share", "room_iou",
    "doors_found",
)  # fmt: skip
"""Figures of which the least of all walks is the worst."""

Figures = dict[str, float]


@dataclass(frozen=True)
class Walked:
    """What the pictures show of a walk.

    Args:
        log: Time and memory.
        stamps, error_m, nees: Position error and NEES of every frame.
    """

    log: WalkLog
    stamps: Float[np.ndarray, "n"]
    error_m: Float[np.ndarray, "n"]
    nees: Float[np.ndarray, "n"]


def config_of(seed: int, body: str, minutes: float) -> Config:
    """Configuration of a walk of that length; its goals never end before."""
    config = on_body(Config(scene="building", seed=seed), body)
    mission = replace(config.mission, goals=10_000, time_limit_s=60.0 * minutes)
    return replace(config, mission=mission, robot=replace(config.robot, stereo=False))


def judge(folder: RunFolder, scene: Scene) -> tuple[Figures, Walked]:
    """Figures of a walk through a scene that `long_walk` wrote, and what is drawn of it."""
    log = read_log(folder)
    estimate = folder.read_trajectory("trajectory.txt")
    true = folder.read_trajectory("truth/trajectory.txt")
    clearance = folder.read_csv("truth/clearance.csv")
    assert estimate is not None
    assert true is not None
    assert clearance is not None
    found = pose_errors(folder, true)
    assert found is not None
    stamps, whitened = found
    own, others = estimate.positions[:, :2], true.positions[:, :2]
    near = np.searchsorted(true.stamps, estimate.stamps)
    error_m = np.linalg.norm(own - others[np.minimum(near, len(others) - 1)], axis=1)
    consistency = consistency_metrics(whitened, "pose")
    errors = trajectory_metrics(estimate, true)
    walk = walk_metrics(true.stamps, true.positions[:, :2])
    goals = (folder.read_json("summary.json") or {}).get("goals_reached") or 0
    first, settled, last = log.part(0), log.part(SETTLED), log.part(-1)
    memory = [float(np.median(log.rss_mb[part])) for part in (first, settled, last)]
    figures = room_figures(folder, scene) | {
        "minutes": walk["duration_s"] / 60.0,
        "path_m": walk["path_m"],
        "goals_reached": float(goals),
        "contacts": contact_metrics(clearance)["contacts"],
        "cycle_p99_first_ms": percentile(log.cycle_ms[first], 99.0),
        "cycle_p99_last_ms": percentile(log.cycle_ms[last], 99.0),
        "cycle_p99_ratio": percentile(log.cycle_ms[last], 99.0)
        / percentile(log.cycle_ms[first], 99.0),
        "busy_p99_ratio": percentile(log.busy_ms[last], 99.0)
        / percentile(log.busy_ms[first], 99.0),
        "busy_median_ratio": float(np.median(log.busy_ms[last]) / np.median(log.busy_ms[first])),
        "rss_first_mb": memory[0],
        "rss_last_mb": memory[2],
        "rss_growth_mb": memory[2] - memory[1],
        "position_rmse_m": float(errors["position_rmse_m"]),
        "position_max_m": float(errors["position_max_m"]),
        "heading_rmse_deg": float(errors["heading_rmse_deg"]),
        "anees_pose": float(consistency["pose_anees"]),
        "anees_low": float(consistency["pose_anees_low"]),
        "anees_high": float(consistency["pose_anees_high"]),
        "anees_in_band": float(consistency["pose_consistent"]),
    }
    return figures, Walked(log, stamps, error_m, squared(whitened))


def room_figures(folder: RunFolder, scene: Scene) -> Figures:
    """Rooms of rooms.json against those of the scene."""
    found = folder.read_json(ROOMS) or {"rooms": [], "doors": []}
    layers, origin, cell_m = geotiff.load(folder.path(world_file.LAYERS))
    occupancy = layers["occupancy"]
    free, seen = occupancy < 0.5, np.isfinite(occupancy)
    y, x = (origin[1 - k] + (np.indices(free.shape)[k] + 0.5) * cell_m for k in (0, 1))
    true = [(x > a) & (x < c) & (y > b) & (y < d) for a, b, c, d in scene.rooms]
    inside = np.any(true, axis=0) & free
    mine = [
        _filled(room["outline_m"], origin, cell_m, free.shape) & inside for room in found["rooms"]
    ]
    best = [
        max((_iou(one & free, other) for other in mine), default=0.0)
        for one in true
        if one.any() and seen[one].mean() >= 0.5
    ]
    widths = []
    for door in found["doors"]:
        near = min(scene.doorways, key=lambda one: math.dist(one[:2], door["centre_m"]))
        if math.dist(near[:2], door["centre_m"]) < NEAR_DOOR_M:
            widths.append(door["width_m"] - near[2])
    return {
        "rooms_seen": float(len(best)),
        "rooms_found_share": float(np.mean(np.array(best) >= 0.5)) if best else math.nan,
        "rooms_too_many": float(len(mine) - len(best)),
        "room_iou": mean(best),
        "doors_found": float(len(widths)),
        "door_width_rmse_m": rms(widths),
    }


def _filled(
    outline: list[list[float]],
    origin: Float[np.ndarray, "2"],
    cell_m: float,
    shape: tuple[int, ...],
) -> Bool[np.ndarray, "rows columns"]:
    """The cells within an outline."""
    corners = np.rint((np.array(outline) - origin) / cell_m - 0.5).astype(np.int32)
    drawn = np.zeros(shape, np.uint8)
    cv2.fillPoly(drawn, [corners], 1)
    return drawn > 0


def _iou(one: Bool[np.ndarray, "rows columns"], other: Bool[np.ndarray, "rows columns"]) -> float:
    return float((one & other).sum() / max((one | other).sum(), 1))


def run(seeds: int, say: Say, body: str = "kinematic", minutes: float = MINUTES) -> Outcome:
    """Seeds 0 to n - 1, one after the other.

    Args:
        seeds: Number of buildings.
        say: Takes lines of progress.
        body: Body that walks.
        minutes: Length of a walk.
    """
    found: list[tuple[Figures, Walked]] = []
    drawn: list[Drawing] = []
    for seed in range(seeds):
        with tempfile.TemporaryDirectory() as place:
            out = Path(place) / "walk"
            config = config_of(seed, body, minutes)
            folder = long_walk(config, out, partial(_say_of, say, seed))
            found.append(judge(folder, catalogue.load("building", seed)))
            if seed == 0:
                drawn = picture_of(folder)
    result = outcome(found)
    return replace(result, drawings=[*result.drawings, *drawn])


def picture_of(folder: RunFolder) -> list[Drawing]:
    """The map of a walk with its rooms, drawn at once: the folder is temporary; empty without rooms."""
    with styled():
        drawn = rooms(folder)
    if drawn is None:
        return []
    return [Drawing("rooms", drawn.sentence, lambda: drawn.figure)]


def _say_of(say: Say, seed: int, text: str) -> None:
    say(f"seed {seed}: {text}")


def outcome(found: list[tuple[Figures, Walked]]) -> Outcome:
    """The worst of all walks, a table of their parts, and the pictures of the first."""
    figures = {name: max(one[name] for one, _ in found) for name in found[0][0]}
    for name in LEAST:
        figures[name] = min(one[name] for one, _ in found)
    figures["anees_pose"] = max(
        (one["anees_pose"] for one, _ in found), key=lambda value: abs(math.log(value / 3.0))
    )
    table = ["seed  part  cycle p99 ms  busy p99 ms  busy median ms  RSS MB  rmse cm  mean NEES"]
    for seed, (_, walked) in enumerate(found):
        log = walked.log
        for number in range(PARTS):
            own = log.part(number)
            at = slice(*np.searchsorted(walked.stamps, log.stamp_s[own][[0, -1]]))
            table.append(
                f"{seed:4d}  {number + 1:4d}  {percentile(log.cycle_ms[own], 99.0):12.1f}"
                f"  {percentile(log.busy_ms[own], 99.0):11.1f}  {np.median(log.busy_ms[own]):14.1f}"
                f"  {np.median(log.rss_mb[own]):6.0f}"
                f"  {100 * np.sqrt(np.mean(walked.error_m[at] ** 2)):7.2f}"
                f"  {np.mean(walked.nees[at]):9.2f}"
            )
    walked = found[0][1]
    return Outcome(figures, table, drawings=[Drawing("hour", SAID, partial(draw, walked))])


SAID = (
    "Processor time of a cycle after the warm-up (median and 99th percentile of a minute), resident memory, position error and NEES of the pose "
    "over the walk; grey lines are the targets and the expected value, the green band that of a single consistent NEES."
)


def draw(walked: Walked) -> Figure:
    """Time, memory, error and NEES over the walk."""
    figure, axes = sheet(4, 1, 7.6, sharex=True)
    log = walked.log
    minutes, own = log.stamp_s / 60.0, walked.stamps / 60.0
    warm = log.part(0).start
    at, cycles = _by_window(minutes[warm:], log.busy_ms[warm:])
    axes[0].plot(at, np.percentile(cycles, 99, axis=1), color=WRONG, label="99 %")
    axes[0].plot(at, np.median(cycles, axis=1), color=ESTIMATE, label="median")
    axes[0].set(ylabel="cycle, ms")
    axes[0].set_ylim(bottom=0.0)
    axes[0].legend(loc="lower right", ncols=2)
    axes[1].plot(minutes, log.rss_mb, color=ESTIMATE)
    axes[1].set(ylabel="memory, MB")
    axes[1].set_ylim(bottom=0.0)
    axes[2].plot(own, 100.0 * walked.error_m, color=ESTIMATE, linewidth=0.6)
    axes[2].axhline(5.0, color="#8A929B", linestyle="--")
    axes[2].set(ylabel="error, cm")
    at, nees = _by_window(own, walked.nees)
    low, high = band(3)
    axes[3].axhspan(low, high, color=TARGET, alpha=0.12, linewidth=0.0)
    axes[3].axhline(3.0, color="#8A929B", linestyle="--")
    axes[3].plot(at, nees.mean(axis=1), color=ESTIMATE)
    axes[3].set(ylabel="NEES, a minute's mean", xlabel="time, min")
    return figure


def _by_window(
    at: Float[np.ndarray, "n"], values: Float[np.ndarray, "n"]
) -> tuple[Float[np.ndarray, "m"], Float[np.ndarray, "m w"]]:
    """Mean instant and values of windows of `WINDOW` cycles, fewer in a short walk; the first cycle is left out."""
    size = max(1, min(WINDOW, (len(values) - 1) // 4))
    count = (len(values) - 1) // size
    inside = slice(1, 1 + count * size)
    return at[inside].reshape(count, size).mean(axis=1), values[inside].reshape(count, size)


EXPERIMENT = Experiment(
    id="building",
    title="An hour's walk through a building of twenty rooms: time, memory, error",
    run=run,
    body="kinematic",
    seeds=1,
    targets={
        "cycle_p99_ratio": Target("<=", 1.1),
        "busy_p99_ratio": Target("<=", 1.1),
        "rss_growth_mb": Target("<=", 20.0),
        "position_rmse_m": Target("<=", 0.05),
        "anees_in_band": Target("==", 1.0),
        "rooms_found_share": Target(">=", 0.9),
        "room_iou": Target(">=", 0.8),
    },
)
