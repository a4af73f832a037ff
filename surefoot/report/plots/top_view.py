"""Top views of a run: trajectory with its uncertainty over the grid, and errors of the grid."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Bool, Float

from perception.primitives.gaussian import Gaussian

from ...evaluation.evaluate import planar_estimates, true_trajectory
from ...evaluation.metrics.maps import FREE, OCCUPIED, UNKNOWN, GridMap, read_map, wrong_cells
from ...evaluation.metrics.obstacles import MOVING, moving
from ...results.run_folder import RunFolder
from .style import ESTIMATE, INK, LANDMARK, SERIES, TARGET, TRUTH, WIDTH_IN, WRONG, Drawn, sheet

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_UNSEEN, _FREE, _OCCUPIED = (0.90, 0.915, 0.93), (1.0, 1.0, 1.0), (0.36, 0.40, 0.45)
_LOST_M = 0.4  # ours: a larger ellipse of a track would hide the map
_MAX_TRACKS = 12  # ours: the longest tracks
_MIN_TRACK = 5  # ours: entries of a track that is drawn
_MAX_ELLIPSES = 26  # ours: along one trajectory
_READABLE_M = 0.05  # ours: smaller ellipses are drawn enlarged, and the legend says so


def trajectory(run: RunFolder) -> Drawn | None:
    """Trajectory over the grid; None if there is neither."""
    grid = read_map(run.path("map.yaml")) if run.has("map.yaml") else None
    table = run.read_csv("trajectory_covariance.csv")
    if grid is None and table is None:
        return None
    figure, axes = grid_sheet(run)
    _tracks(axes, run)
    _truth(axes, run)
    if table is not None:
        stamps, poses, covariances = planar_estimates(table)
        _estimate(axes, poses, covariances, list(run.sessions(stamps).values()))
    elif (given := run.read_trajectory("trajectory.txt")) is not None:
        x, y = given.positions[:, 0], given.positions[:, 1]
        axes.plot(x, y, color=ESTIMATE, lw=1.8, zorder=6, label="poses of the recording")
    _marks(axes, run)
    _legend(axes)
    sentence = "Poses of the recording"
    if table is not None:
        sentence = "Estimated trajectory with the 95 % ellipses of its position"
    if true_trajectory(run) is not None:
        sentence += " and, dashed, the true trajectory"
    if grid is not None:
        sentence += ", over the occupancy grid: white is free, dark occupied, grey unknown"
    return Drawn(figure, f"{sentence}.")


def grid_sheet(run: RunFolder) -> tuple[Figure, Axes]:
    """Axes over what the run saw and where it went, with its grid if it has one."""
    grid = read_map(run.path("map.yaml")) if run.has("map.yaml") else None
    box = _frame(grid, run)
    figure, axes = _sheet(box)
    axes.set_autoscale_on(False)
    axes.set_xlim(box[0], box[1])
    axes.set_ylim(box[2], box[3])
    if grid is not None:
        picture = np.full((*grid.state.shape, 3), _UNSEEN)
        picture[grid.state == FREE] = _FREE
        picture[grid.state == OCCUPIED] = _OCCUPIED
        _show(axes, picture, grid)
    return figure, axes


def grid_check(run: RunFolder) -> Drawn | None:
    """Correct and wrong cells of the grid; None without a true map."""
    if not run.has("map.yaml") or not run.has("truth/map.yaml"):
        return None
    grid, truth = read_map(run.path("map.yaml")), read_map(run.path("truth/map.yaml"))
    judged = (grid.state != UNKNOWN) & (truth.at(grid.centres()) != UNKNOWN)
    wrong = wrong_cells(grid, truth)
    picture = np.full((*grid.state.shape, 3), _UNSEEN)
    picture[judged & (grid.state == FREE)] = (0.93, 0.965, 0.955)
    picture[judged & (grid.state == OCCUPIED)] = (0.62, 0.75, 0.71)
    picture[wrong == 1] = (0.94, 0.79, 0.25)
    picture[wrong == 2] = (0.835, 0.369, 0.0)
    box = _frame(grid, run)
    figure, axes = _sheet(box, share=0.72)
    _show(axes, picture, grid)
    outline = np.where(truth.state == OCCUPIED, 1.0, 0.0)
    left, right, bottom, top = truth.extent
    half = truth.cell_m / 2
    x = np.linspace(left + half, right - half, outline.shape[1])
    y = np.linspace(bottom + half, top - half, outline.shape[0])
    axes.contour(x, y, outline, levels=[0.5], colors=[TRUTH], linewidths=0.6)
    for colour, words in (
        ((0.93, 0.965, 0.955), "correct: free"), ((0.62, 0.75, 0.71), "correct: occupied"),
        ((0.94, 0.79, 0.25), "off by one cell"), ((0.835, 0.369, 0.0), "wrong"),
    ):  # fmt: skip
        axes.plot([], [], "s", color=colour, markeredgecolor="#8A929B", mew=0.4, label=words)
    axes.plot([], [], color=TRUTH, lw=0.8, label="true outline")
    axes.set_xlim(box[0], box[1])
    axes.set_ylim(box[2], box[3])
    _legend(axes, 5)
    sentence = (
        "Every observed cell compared with the true map: pale cells are correct, yellow ones are wrong by one cell "
        "at most, vermilion ones are wrong."
    )
    return Drawn(figure, sentence)


def _sheet(box: tuple[float, float, float, float], share: float = 1.0) -> tuple[Figure, Any]:
    """Axes with equal scales, in the proportions of the scene."""
    wide, high = box[1] - box[0], box[3] - box[2]
    height_in = float(np.clip(share * (WIDTH_IN - 0.6) * high / wide + 0.95, 3.2, 8.5))
    figure, axes = sheet(1, 1, height_in)
    axes.set_aspect("equal")
    axes.grid(False)
    axes.set(xlabel="x, m", ylabel="y, m")
    return figure, axes


def _frame(grid: GridMap | None, run: RunFolder) -> tuple[float, float, float, float]:
    """(left, right, bottom, top) of observed cells, trajectories and goals, m."""
    points = []
    if grid is not None and (grid.state != UNKNOWN).any():
        points.append(grid.centres()[grid.state != UNKNOWN])
    for path in (run.read_trajectory("trajectory.txt"), true_trajectory(run)):
        if path is not None:
            points.append(path.positions[:, :2])
    summary = run.read_json("summary.json") or {}
    for goal in summary.get("goal_positions") or []:
        points.append(np.array([goal[:2]], dtype=np.float64))
    if not points:
        return -1.0, 1.0, -1.0, 1.0
    everything = np.concatenate(points)
    (left, bottom), (right, top) = everything.min(axis=0) - 0.2, everything.max(axis=0) + 0.2
    return float(left), float(right), float(bottom), float(top)


def _show(axes: Axes, picture: Float[np.ndarray, "rows columns 3"], grid: GridMap) -> None:
    axes.set_facecolor(_UNSEEN)
    axes.imshow(
        picture,
        origin="lower",
        extent=grid.extent,
        interpolation="nearest",
        zorder=0,
        aspect="equal",
    )


def _estimate(
    axes: Axes,
    poses: Float[np.ndarray, "n 3"],
    covariances: Float[np.ndarray, "n 3 3"],
    sessions: Sequence[Bool[np.ndarray, "n"]],
) -> None:
    """Estimated trajectory of each session with ellipses at regular intervals, start and final heading."""
    for number, mine in enumerate(sessions):
        label = None if number else "estimate"
        axes.plot(*poses[mine, :2].T, color=ESTIMATE, lw=1.8, zorder=6, label=label)
    chosen = np.unique(np.linspace(0, len(poses) - 1, _MAX_ELLIPSES).astype(int))
    gaussians = [Gaussian(poses[i, :2], covariances[i, :2, :2]) for i in chosen]
    enlarged = _enlargement(gaussians)
    for gaussian in gaussians:
        _ellipse(axes, gaussian, enlarged, ESTIMATE)
    words = "95 % ellipses" + (f", enlarged {enlarged:.0f} times" if enlarged > 1 else "")
    axes.plot([], [], "o", mfc="none", mec=ESTIMATE, ms=7, mew=0.8, label=words)
    arrow = {"arrowstyle": "-|>", "color": ESTIMATE, "lw": 1.6}
    for mine in sessions:
        axes.plot(*poses[mine][0, :2], "o", color=ESTIMATE, ms=5, zorder=7)
        x, y, yaw = (float(v) for v in poses[mine][-1])
        ahead = (x + 0.16 * math.cos(yaw), y + 0.16 * math.sin(yaw))
        axes.annotate("", ahead, (x, y), arrowprops=arrow, zorder=7)


def _enlargement(gaussians: list[Gaussian]) -> float:
    """Integer factor that makes the median ellipse readable."""
    typical = float(np.median([gaussian.ellipse()[0] for gaussian in gaussians]))
    if not 0.0 < typical < _READABLE_M:
        return 1.0
    return float(min(np.ceil(_READABLE_M / typical), 10.0))


def _ellipse(axes: Axes, gaussian: Gaussian, enlarged: float, colour: str) -> None:
    from matplotlib.colors import to_rgba
    from matplotlib.patches import Ellipse

    long, short, direction = gaussian.ellipse()
    x, y = (float(v) for v in gaussian.mean[:2])
    axes.add_patch(
        Ellipse(
            (x, y), 2 * enlarged * long, 2 * enlarged * short, angle=float(np.degrees(direction)),
            facecolor=to_rgba(colour, 0.13), edgecolor=to_rgba(colour, 0.7), lw=0.7, zorder=5,
        )
    )  # fmt: skip


def _truth(axes: Axes, run: RunFolder) -> None:
    """True trajectories of the robot and of moving obstacles, thin and dashed."""
    path = true_trajectory(run)
    if path is not None:
        x, y = path.positions[:, 0], path.positions[:, 1]
        axes.plot(x, y, color=TRUTH, lw=1.0, ls=(0, (4, 2.5)), zorder=8, label="truth")
    table = run.read_csv("truth/obstacles.csv")
    if table is None:
        return
    words, positions = table.words("identity"), table.matrix("x_m", "y_m")
    for number, identity in enumerate(moving(table)):
        rows = np.array([word == identity for word in words])
        label = None if number else "moving obstacle, truth"
        axes.plot(*positions[rows].T, color=TRUTH, lw=0.8, ls=(0, (1.5, 2)), zorder=4, label=label)


def _tracks(axes: Axes, run: RunFolder) -> None:
    """Tracks of moving obstacles, and footprints of static ones."""
    obstacles = run.read_json("obstacles.json")
    if not obstacles:
        return
    from matplotlib.colors import to_rgba
    from matplotlib.patches import Polygon

    for footprint in obstacles.get("footprints", []):
        ring = np.array(footprint["outline_m"], dtype=np.float64)
        axes.add_patch(
            Polygon(ring, facecolor=to_rgba(SERIES[1], 0.18), edgecolor="none", zorder=3)
        )
        for k, side in enumerate(footprint["sides"]):
            ends = ring[[k, (k + 1) % len(ring)]]
            style = {"lw": 1.2} if side["seen"] else {"lw": 0.7, "ls": (0, (1.5, 1.5))}
            axes.plot(*ends.T, color=SERIES[1], zorder=3, solid_capstyle="butt", **style)
    if obstacles.get("footprints"):
        axes.plot([], [], color=SERIES[1], lw=1.2, label="footprint, side seen")
        axes.plot(
            [], [], color=SERIES[1], lw=0.7, ls=(0, (1.5, 1.5)), label="footprint, side not seen"
        )
    by_track: dict[int, list[dict[str, Any]]] = {}
    for entry in obstacles["tracks"]:
        if float(entry["moving"]) >= MOVING:
            by_track.setdefault(int(entry["track"]), []).append(entry)
    longest = sorted(by_track.values(), key=lambda entries: -len(entries))[:_MAX_TRACKS]
    for number, entries in enumerate(entries for entries in longest if len(entries) >= _MIN_TRACK):
        means = np.array([entry["mean"][:2] for entry in entries], dtype=np.float64)
        label = None if number else "moving obstacle, tracked"
        axes.plot(*means.T, color=WRONG, lw=1.3, zorder=5, label=label)
        covariance = np.array(entries[-1]["covariance"], dtype=np.float64)
        last = Gaussian(means[-1], covariance[:2, :2])
        if last.ellipse()[0] < _LOST_M:
            _ellipse(axes, last, 1.0, WRONG)


def _marks(axes: Axes, run: RunFolder) -> None:
    """Start, goals and landmarks."""
    summary = run.read_json("summary.json") or {}
    marks = np.array([mark[1:3] for mark in summary.get("landmarks") or []], dtype=np.float64)
    if len(marks):
        axes.plot(*marks.T, "D", color=LANDMARK, ms=4.5, zorder=6, ls="", label="landmark")
    for number, goal in enumerate(summary.get("goal_positions") or []):
        axes.plot(
            goal[0], goal[1], "*", color=TARGET, ms=14, mec="white", mew=0.8, zorder=9, ls="",
            label="goal" if number == 0 else None,
        )  # fmt: skip
        if len(summary["goal_positions"]) > 1:
            axes.annotate(
                str(number + 1), (goal[0], goal[1]), xytext=(7, 4), textcoords="offset points",
                color=INK, fontsize=8, zorder=9,
            )  # fmt: skip


_LEGEND = ("estimate", "95 %", "truth", "goal", "landmark", "moving", "footprint")


def _legend(axes: Axes, columns: int = 4) -> None:
    """Above the axes, the estimate first."""
    handles, labels = axes.get_legend_handles_labels()
    if not handles:
        return

    def place(pair: tuple[Any, str]) -> int:
        return next((i for i, word in enumerate(_LEGEND) if pair[1].startswith(word)), len(_LEGEND))

    ordered = sorted(zip(handles, labels, strict=True), key=place)
    axes.legend(
        *zip(*ordered, strict=True), loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=columns,
        borderaxespad=0.2, handlelength=1.6, columnspacing=1.4,
    )  # fmt: skip
