"""Pictures of a run over time; pictures only, every number in them comes from the run's files.

`pictures` draws all that the run has data for. The plan views are in `plots_plan`, those of covariances in
`plots_trust`, those of a mapped recording in `plots_way`.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from ...evaluation.evaluate import planar_estimates
from ...evaluation.metrics.contacts import contact_intervals
from ...evaluation.metrics.floor import floor_errors
from ...evaluation.metrics.obstacles import moving, track_errors
from ...evaluation.metrics.timing import stages
from ...evaluation.metrics.trajectory import associate, wrapped
from ...results.run_folder import RunFolder
from .style import BELIEF, FAINT, SERIES, TRUTH, WRONG, Drawn, bound, key, sheet, styled, svg


@dataclass(frozen=True)
class Picture:
    """One figure of the report.

    Args:
        identity: Name of the file and of the element in the page.
        title: Heading.
        sentence: What one sees.
        svg: The picture.
    """

    identity: str
    title: str
    sentence: str
    svg: bytes


def pictures(run: RunFolder) -> list[Picture]:
    """Every picture that the run has data for, in the order of the report.

    Raises:
        RecordingError: A file of the run cannot be read.
    """
    from . import consistency, top_view, trajectory

    drawn = []
    kinds: tuple[tuple[str, str, Callable[[RunFolder], Drawn | None]], ...] = (
        ("map", "Where it went", top_view.plan),
        ("surface", "What it looks like", trajectory.surface),
        ("aligned", "How wrong the way was, and what it claimed", trajectory.aligned_errors),
        ("pose", "How wrong the pose was", pose_errors),
        ("nees", "Whether the covariance is honest", consistency.nees_over_time),
        ("calibration", "Whether every claim holds as often as it says", consistency.calibration),
        ("whiteness", "Whether every surprise is new", consistency.whiteness),
        ("clearance", "How close it came", clearance),
        ("floor", "The floor", floor),
        ("grid", "The map against the truth", top_view.grid_check),
        ("tracks", "What moved", tracks),
        ("commands", "What it decided", commands),
        ("timing", "Where the time went", timing),
    )
    with styled():
        for identity, title, draw in kinds:
            result = draw(run)
            if result is not None:
                drawn.append(Picture(identity, title, result.sentence, svg(result.figure)))
    return drawn


def pose_errors(run: RunFolder) -> Drawn | None:
    """Errors of x, y and yaw with the claimed deviation; None without truth or covariance."""
    table, true = (
        run.read_csv("trajectory_covariance.csv"),
        run.read_trajectory("truth/trajectory.txt"),
    )
    if table is None or true is None:
        return None
    stamps, poses, covariances = planar_estimates(table)
    mine, theirs = associate(stamps, true.stamps)
    if len(mine) == 0:
        return None
    errors = poses[mine] - np.column_stack([true.positions[theirs, :2], true.yaws[theirs]])
    errors[:, 2] = np.degrees(wrapped(errors[:, 2]))
    deviations = np.sqrt(np.maximum(np.diagonal(covariances[mine], axis1=1, axis2=2), 0.0))
    deviations[:, 2] = np.degrees(deviations[:, 2])
    errors[:, :2] *= 100.0
    deviations[:, :2] *= 100.0
    seconds = _since_start(stamps[mine])
    figure, axes = sheet(3, 1, 4.4, sharex=True)
    for i, words in enumerate(("x error, cm", "y error, cm", "heading error, deg")):
        axes[i].fill_between(
            seconds, -2 * deviations[:, i], 2 * deviations[:, i], color=BELIEF, alpha=0.14, lw=0,
            label="two deviations",
        )  # fmt: skip
        axes[i].axhline(0.0, color=TRUTH, linewidth=0.7)
        axes[i].plot(seconds, errors[:, i], color=BELIEF, label="error")
        axes[i].set_ylabel(words)
    key(axes[0])
    axes[2].set_xlabel("time, s")
    sentence = (
        "Estimated minus true position and heading; the band is two deviations of the estimate's own "
        "covariance and should hold the line about 95 % of the time."
    )
    return Drawn(figure, sentence)


def clearance(run: RunFolder) -> Drawn | None:
    """Gap to the nearest thing over time; None without truth."""
    table = run.read_csv("truth/clearance.csv")
    if table is None:
        return None
    stamps, gaps, things = (
        table.numbers("stamp_s"), table.numbers("clearance_m"), table.words("thing"),
    )  # fmt: skip
    seconds = _since_start(stamps)
    figure, axes = sheet(1, 1, 2.3)
    axes.fill_between(seconds, 0.0, gaps, color=FAINT, alpha=0.35, lw=0)
    axes.plot(seconds, gaps, color=TRUTH, linewidth=1.2)
    axes.axhline(0.0, color=WRONG, linewidth=1.2)
    for begin, end, _ in contact_intervals(stamps, gaps, things):
        axes.axvspan(begin - stamps[0] - 0.2, end - stamps[0] + 0.2, color=WRONG, alpha=0.35, lw=0)
    nearest = int(np.nanargmin(gaps))
    axes.plot(seconds[nearest], gaps[nearest], "o", color=WRONG, markersize=4)
    axes.annotate(
        f"{100 * gaps[nearest]:.1f} cm to {things[nearest]}",
        (seconds[nearest], gaps[nearest]), xytext=(0, -14), textcoords="offset points",
        color=WRONG, fontsize=8, ha="center",
    )  # fmt: skip
    axes.set_ylim(min(0.0, float(gaps[nearest])) - 0.12 * _most(gaps, 0.1), 1.08 * _most(gaps, 0.1))
    axes.set(xlabel="time, s", ylabel="clearance, m")
    sentence = "True gap between the robot and whatever was nearest, and what that was; at zero they touch."
    return Drawn(figure, sentence)


def floor(run: RunFolder) -> Drawn | None:
    """Errors of the floor plane over time, or the plane itself where no truth is known."""
    table, truth = run.read_csv("floor.csv"), run.read_csv("truth/floor.csv")
    if table is None:
        return None
    errors = {} if truth is None else floor_errors(table, truth)
    figure, axes = sheet(2, 1, 3.7, sharex=True)
    sentence = "Error of the floor's tilt and height in every frame, camera by camera"
    if errors:
        start = min(float(one.stamps[0]) for one in errors.values())
        for colour, (camera, one) in zip(SERIES, errors.items(), strict=False):
            seconds = one.stamps - start
            axes[0].plot(seconds, one.angles_deg, color=colour, lw=1.0, alpha=0.9, label=camera)
            axes[1].plot(seconds, one.heights_mm, color=colour, lw=1.0, alpha=0.9)
        axes[0].set(ylabel="tilt error, deg", ylim=(0, None))
        axes[1].set(ylabel="height error, mm", xlabel="time, s")
        axes[1].axhline(0.0, color=TRUTH, linewidth=0.7)
        bound(axes[0], 0.5, "target of the TOF median")
    else:
        sentence = "Height of the camera over the floor, and the share of its points that lie on it"
        stamps, heights = table.numbers("stamp_s"), table.numbers("height_m")
        seen = np.array([state == "seen" for state in table.words("state")])
        sigma = np.sqrt(np.maximum(table.numbers("P22"), 0.0))
        for colour, camera in zip(SERIES, dict.fromkeys(table.words("camera")), strict=False):
            chosen = np.array([word == camera for word in table.words("camera")]) & seen
            seconds = stamps[chosen] - stamps[0]
            axes[0].errorbar(
                seconds, heights[chosen], 2 * sigma[chosen], color=colour, fmt=".", ms=3, lw=0.7,
                label=camera,
            )  # fmt: skip
            axes[1].plot(seconds, 100 * table.numbers("share")[chosen], ".", color=colour, ms=3)
        axes[0].set_ylabel("camera height, m")
        axes[1].set(ylabel="points on it, %", xlabel="time, s", ylim=(0, 100))
    key(axes[0])
    return Drawn(figure, f"{sentence}; gaps are frames without a floor.")


def tracks(run: RunFolder) -> Drawn | None:
    """Position error and speed of every moving obstacle; None without truth or movers."""
    obstacles, truth = run.read_json("obstacles.json"), run.read_csv("truth/obstacles.csv")
    if not obstacles or truth is None or not moving(truth):
        return None
    errors = track_errors(obstacles["tracks"], truth)
    stamps, words = truth.numbers("stamp_s"), truth.words("identity")
    velocities = truth.matrix("vx_mps", "vy_mps")
    every = np.unique(stamps)
    figure, axes = sheet(2, 1, 3.7, sharex=True)
    for colour, identity in zip(SERIES, moving(truth), strict=False):
        rows = np.array([word == identity for word in words])
        speed = np.linalg.norm(velocities[rows], axis=1)
        axes[1].plot(stamps[rows] - every[0], 100 * speed, color=colour, lw=1.0, ls=(0, (4, 2)))
        chosen = np.array([name == identity for name in errors.identities], dtype=bool)
        apart, believed = np.full((2, len(every)), np.nan)
        at = np.searchsorted(every, errors.stamps[chosen])
        apart[at] = 100 * np.linalg.norm(errors.errors[chosen, :2], axis=1)
        true_velocity = velocities[rows][np.searchsorted(stamps[rows], errors.stamps[chosen])]
        believed[at] = 100 * np.linalg.norm(true_velocity + errors.errors[chosen, 2:], axis=1)
        axes[0].plot(every - every[0], apart, color=colour, label=identity)
        axes[1].plot(every - every[0], believed, color=colour)
    axes[0].set(ylabel="position error, cm", ylim=(0, None))
    axes[1].set(ylabel="speed, cm/s", xlabel="time, s", ylim=(0, None))
    key(axes[0])
    sentence = (
        "Distance between each moving obstacle and its track, and its speed as believed (solid) and in truth "
        "(dashed); gaps are times without a track."
    )
    return Drawn(figure, sentence)


def commands(run: RunFolder) -> Drawn | None:
    """Walk and gaze commands over time; None for a recording."""
    table = run.read_csv("commands.csv")
    if table is None:
        return None
    seconds = _since_start(table.numbers("stamp_s"))
    figure, axes = sheet(2, 1, 3.7, sharex=True)
    for colour, name, words in (
        (SERIES[0], "forward_m", "ahead, cm"), (SERIES[1], "lateral_m", "to the left, cm"),
    ):  # fmt: skip
        axes[0].step(seconds, 100 * table.numbers(name), where="post", color=colour, label=words)
    turn = np.degrees(table.numbers("turn_rad"))
    axes[0].step(seconds, turn, where="post", color=SERIES[2], lw=0.9, label="turn left, deg")
    for colour, name, words in (
        (SERIES[0], "pan_rad", "pan left, deg"), (SERIES[1], "tilt_rad", "tilt down, deg"),
    ):  # fmt: skip
        axes[1].step(
            seconds, np.degrees(table.numbers(name)), where="post", color=colour, label=words
        )
    axes[0].set_ylabel("footstep")
    axes[1].set(ylabel="gaze", xlabel="time, s")
    for one in axes:
        key(one)
    sentence = "Every footstep (ahead, sideways, turn) and where the head was sent to look."
    return Drawn(figure, sentence)


def timing(run: RunFolder) -> Drawn | None:
    """Time per stage; None if nothing was timed."""
    table = run.read_csv("timing.csv")
    columns = {} if table is None else stages(table)
    if table is None or not columns or len(table) < 2:
        return None
    means: dict[str, float] = defaultdict(float)
    for name, values in columns.items():
        means[name] = float(np.mean(values[1:]))
    order = sorted(columns, key=lambda name: (-means[name], name))
    shown, rest = order[:7], order[7:]
    rows = {name: columns[name][1:] for name in shown}
    if rest:
        rows["the rest"] = np.sum([columns[name][1:] for name in rest], axis=0)
    seconds = (table.numbers("stamp_s") - table.numbers("stamp_s")[0])[1:]
    figure, axes = sheet(1, 2, 2.9, width_ratios=(3, 2))
    axes[0].stackplot(seconds, list(rows.values()), colors=SERIES[: len(rows)], lw=0, alpha=0.8)
    axes[0].set(xlabel="time, s", ylabel="ms per frame", xlim=(seconds[0], seconds[-1]))
    for i, values in enumerate(rows.values()):
        low, middle, high = np.percentile(values, (5, 50, 95))
        axes[1].plot((low, high), (i, i), color=SERIES[i], linewidth=3.5, alpha=0.45)
        axes[1].plot(middle, i, "o", color=SERIES[i], markersize=5)
        axes[1].annotate(
            f"{middle:.1f}", (high, i), xytext=(5, 0), textcoords="offset points", va="center",
            fontsize=8,
        )  # fmt: skip
    axes[1].set_yticks(range(len(rows)), list(rows))
    axes[1].invert_yaxis()
    axes[1].margins(x=0.15)
    axes[1].set_xlim(left=0)
    axes[1].set_xlabel("ms, median")
    sentence = (
        "Wall time of every stage: stacked frame by frame, and as median (dot) with the middle 90 % (line). "
        "The first frame is left out."
    )
    return Drawn(figure, sentence)


def _since_start(stamps: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
    return stamps - stamps[0]


def _most(values: Any, otherwise: float) -> float:
    finite = values[np.isfinite(values)]
    return float(np.max(finite)) if len(finite) else otherwise
