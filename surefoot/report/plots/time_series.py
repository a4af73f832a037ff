"""Plots over time: errors, clearance, floor, moving obstacles, commands and computing time."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float

from ...evaluation.evaluate import planar_estimates, true_trajectory
from ...evaluation.metrics.contacts import contact_intervals, nearest_objects
from ...evaluation.metrics.floor import floor_errors
from ...evaluation.metrics.gauge_alignment import FLOOR, SPACE
from ...evaluation.metrics.obstacles import moving, track_errors
from ...evaluation.metrics.timing import stages
from ...evaluation.metrics.trajectory import associate, wrapped
from ...results.run_folder import ERRORS, PLAYBACK, SIMULATION, RunFolder
from .style import ESTIMATE, FAINT, SERIES, TRUTH, WRONG, Drawn, bound, legend, sheet

PARTS = 60
"""Ours: of a run, whose frames are averaged; single frames of different cameras make a comb."""
OUTLIER = 2.0
"""Ours: frames that take longer than this multiple of the 95th percentile are not drawn."""


def pose_errors(run: RunFolder) -> Drawn | None:
    """Errors of x, y and yaw with their standard deviation; None without truth or covariance."""
    table, true = run.read_csv("trajectory_covariance.csv"), true_trajectory(run)
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
            seconds, -2 * deviations[:, i], 2 * deviations[:, i], color=ESTIMATE, alpha=0.14, lw=0,
            label="two standard deviations",
        )  # fmt: skip
        axes[i].axhline(0.0, color=TRUTH, linewidth=0.7)
        axes[i].plot(seconds, errors[:, i], color=ESTIMATE, label="error")
        axes[i].set_ylabel(words)
    legend(axes[0])
    axes[2].set_xlabel("time, s")
    sentence = (
        "Estimated minus true position and heading. The band is two standard deviations; the error of a "
        "consistent estimate stays inside it about 95 % of the time."
    )
    return Drawn(figure, sentence)


def aligned_errors(run: RunFolder) -> Drawn | None:
    """Errors after alignment with their standard deviation; None if the run was not evaluated so."""
    table = run.read_csv(ERRORS)
    if table is None:
        return None
    names = SPACE if "error_z" in table.columns else FLOOR
    lengths = 3 if names is SPACE else 2
    stamps = table.numbers("stamp_s")
    figure, axes = sheet(len(names), 1, 1.15 * len(names) + 0.7, sharex=True)
    for i, (one, name) in enumerate(zip(axes, names, strict=True)):
        scale, unit = (100.0, "cm") if i < lengths else (180.0 / math.pi, "deg")
        sigma = 2.0 * scale * table.numbers(f"sigma_{name}")
        seconds = stamps - stamps[0]
        one.fill_between(
            seconds,
            -sigma,
            sigma,
            color=ESTIMATE,
            alpha=0.14,
            lw=0,
            label="two standard deviations",
        )
        one.axhline(0.0, color=TRUTH, linewidth=0.7)
        one.plot(seconds, scale * table.numbers(f"error_{name}"), color=ESTIMATE, label="error")
        one.set_ylabel(f"{name.replace('_', ' ')}, {unit}")
    legend(axes[0])
    axes[-1].set_xlabel("time, s")
    sentence = (
        "Estimated minus true pose after rigid alignment of the trajectory. The band is two standard deviations "
        "after the same alignment; the error of a consistent estimate stays inside it about 95 % of the time."
    )
    return Drawn(figure, sentence)


def clearance(run: RunFolder) -> Drawn | None:
    """Distance of a walk to the nearest object over time; None without truth."""
    table = run.read_csv("truth/clearance.csv")
    if table is None or run.kind not in (SIMULATION, PLAYBACK):
        return None
    stamps, gaps = table.numbers("stamp_s"), table.numbers("clearance_m")
    objects = nearest_objects(table)
    if not np.isfinite(gaps).any():
        return None
    seconds = _since_start(stamps)
    figure, axes = sheet(1, 1, 2.3)
    axes.fill_between(seconds, 0.0, gaps, color=FAINT, alpha=0.35, lw=0)
    axes.plot(seconds, gaps, color=TRUTH, linewidth=1.2)
    axes.axhline(0.0, color=WRONG, linewidth=1.2)
    for begin, end, _ in contact_intervals(stamps, gaps, objects):
        axes.axvspan(begin - stamps[0] - 0.2, end - stamps[0] + 0.2, color=WRONG, alpha=0.35, lw=0)
    nearest = int(np.nanargmin(gaps))
    axes.plot(seconds[nearest], gaps[nearest], "o", color=WRONG, markersize=4)
    axes.annotate(
        f"{100 * gaps[nearest]:.1f} cm to {objects[nearest]}",
        (seconds[nearest], min(gaps[nearest], 0.0)), xytext=(0, -11), textcoords="offset points",
        color=WRONG, fontsize=8, ha="center",
    )  # fmt: skip
    top = max(float(np.nanmax(gaps)), 0.1)
    axes.set_ylim(min(0.0, float(gaps[nearest])) - 0.16 * top, 1.08 * top)
    axes.set(xlabel="time, s", ylabel="clearance, m")
    sentence = (
        "True distance between the robot and the nearest object; zero is a contact. The smallest is marked, with the "
        "name of that object in the scene."
    )
    return Drawn(figure, sentence)


def floor(run: RunFolder) -> Drawn | None:
    """Errors of the floor plane over time, or the plane itself without ground truth."""
    table, truth = run.read_csv("floor.csv"), run.read_csv("truth/floor.csv")
    if table is None:
        return None
    errors = {} if truth is None else floor_errors(table, truth)
    figure, axes = sheet(2, 1, 3.7, sharex=True)
    sentence = "Error of tilt and height of the floor in every frame of each camera"
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
        sentence = "Height of each camera above the floor, and the share of its points on the floor"
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
        axes[1].set(ylabel="points on floor, %", xlabel="time, s", ylim=(0, 100))
    legend(axes[0])
    return Drawn(figure, f"{sentence}. Gaps are frames without a detected floor.")


def tracks(run: RunFolder) -> Drawn | None:
    """Position error and speed of every moving obstacle; None without truth or moving obstacles."""
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
        apart, estimated = np.full((2, len(every)), np.nan)
        at = np.searchsorted(every, errors.stamps[chosen])
        apart[at] = 100 * np.linalg.norm(errors.errors[chosen, :2], axis=1)
        true_velocity = velocities[rows][np.searchsorted(stamps[rows], errors.stamps[chosen])]
        estimated[at] = 100 * np.linalg.norm(true_velocity + errors.errors[chosen, 2:], axis=1)
        label = f"mover {identity}" if identity.isdigit() else identity
        axes[0].plot(every - every[0], apart, color=colour, label=label)
        axes[1].plot(every - every[0], estimated, color=colour)
    axes[0].set(ylabel="position error, cm", ylim=(0, None))
    axes[1].set(ylabel="speed, cm/s", xlabel="time, s", ylim=(0, None))
    legend(axes[0])
    sentence = (
        "Distance between each moving obstacle and its track, and its estimated (solid) and true (dashed) speed. "
        "Gaps are times without a track."
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
        (SERIES[0], "forward_m", "forward, cm"), (SERIES[1], "lateral_m", "left, cm"),
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
        legend(one)
    sentence = "Commanded footsteps (forward, lateral, turn) and head angles (pan, tilt)."
    return Drawn(figure, sentence)


def timing(run: RunFolder) -> Drawn | None:
    """Computing time per stage, without the first frame; None with fewer than two other frames."""
    table = run.read_csv("timing.csv")
    columns = {} if table is None else stages(table)
    if table is None or not columns or len(table) < 3:
        return None
    columns = {name: values[1:] for name, values in columns.items()}
    order = sorted(columns, key=lambda name: (-float(np.mean(columns[name])), name))
    shown, rest = order[:7], order[7:]
    rows = {name: columns[name] for name in shown}
    if rest:
        rows["other stages"] = np.sum([columns[name] for name in rest], axis=0)
    seconds = _since_start(table.numbers("stamp_s"))[1:]
    total = np.sum(list(rows.values()), axis=0)
    limit = OUTLIER * float(np.percentile(total, 95))  # a stage compiles when it first runs
    outliers = int(np.count_nonzero(total > limit))
    figure, axes = sheet(1, 2, 2.9, width_ratios=(3, 2))
    parts = np.array_split(np.flatnonzero(total <= limit), min(len(seconds), PARTS))
    means = [[values[part].mean() for part in parts if len(part)] for values in rows.values()]
    middles = [seconds[part].mean() for part in parts if len(part)]
    axes[0].stackplot(middles, means, colors=SERIES[: len(rows)], lw=0, alpha=0.8)
    axes[0].set(xlabel="time, s", ylabel="ms per frame")
    if middles[-1] > middles[0]:
        axes[0].set_xlim(middles[0], middles[-1])
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
        f"Computing time of every stage: stacked, the mean of {_few(len(parts[0]))} (left), and median (dot) with the "
        "range from 5 to 95 % (line). The first frame is left out, because it includes compilation"
    )
    if outliers:
        sentence += f"; on the left, so are others that took over {limit:.0f} ms ({outliers})"
    return Drawn(figure, f"{sentence}.")


def _few(count: int) -> str:
    return "one frame" if count == 1 else f"{count} frames"


def _since_start(stamps: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
    return stamps - stamps[0]
