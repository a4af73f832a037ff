"""Plots of consistency: NEES over time, calibration of regions, whiteness of innovations, claimed risk of contact."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from perception.filtering import consistency

from ...evaluation.evaluate import pose_errors, true_trajectory
from ...evaluation.metrics.consistency import effective_samples, squared
from ...evaluation.metrics.floor import floor_errors
from ...evaluation.metrics.innovations import autocorrelation, innovations
from ...evaluation.metrics.obstacles import moving, track_errors
from ...evaluation.metrics.risk import risk_of_run
from ...results.run_folder import RunFolder
from .style import ESTIMATE, FAINT, SERIES, TARGET, TRUTH, WRONG, Drawn, legend, sheet

MIN_SAMPLES = 20  # ours: fewer samples give no curve


def nees_over_time(run: RunFolder) -> Drawn | None:
    """NEES of the pose with its band; None without truth or covariance."""
    true = true_trajectory(run)
    errors = None if true is None else pose_errors(run, true)
    if errors is None:
        return None
    stamps, values = errors[0], squared(errors[1])
    low, high = consistency.band(3)
    figure, axes = sheet(1, 1, 2.5)
    axes.axhspan(low, high, color=TARGET, alpha=0.12, lw=0, label="95 % band")
    axes.axhline(3.0, color=TARGET, linewidth=1.0, linestyle=(0, (5, 3)), label="expected mean")
    bottom = low / 5
    finite = np.where(np.isfinite(values), np.maximum(values, 1.05 * bottom), np.nan)
    inside = (values >= low) & (values <= high)
    seconds = stamps - stamps[0]
    axes.plot(seconds, finite, color=ESTIMATE, linewidth=0.8, alpha=0.5)
    axes.scatter(seconds[inside], finite[inside], s=7, color=ESTIMATE, label="inside", zorder=3)
    axes.scatter(
        seconds[~inside], finite[~inside], s=12, color=WRONG, marker="x", linewidths=0.9,
        label="outside", zorder=3,
    )  # fmt: skip
    axes.set_yscale("log")
    axes.set_ylim(bottom, max(high * 2, float(np.nanmax(np.append(finite, high))) * 1.3))
    axes.set(xlabel="time, s", ylabel="NEES of x, y, yaw")
    legend(axes)
    sentence = (
        "Normalised estimation error squared (NEES) of the pose. If the covariance is consistent, 95 % of the points "
        "lie in the band and the mean is 3; above the band it is over-confident, below under-confident."
    )
    return Drawn(figure, sentence)


def calibration(run: RunFolder) -> Drawn | None:
    """Share of errors inside each confidence region, one curve per estimate; None without any."""
    curves = _normalised(run)
    if not curves:
        return None
    from matplotlib.ticker import NullLocator

    figure, axes = sheet(1, 2, 3.4)
    inner, text = axes
    effective = min(curve.samples for curve in curves)
    nominal = np.linspace(0.0, 1.0, 101)
    spread = 1.96 * np.sqrt(nominal * (1.0 - nominal) / effective)
    inner.fill_between(nominal, nominal - spread, nominal + spread, color=TARGET, alpha=0.12, lw=0)
    inner.plot([0, 1], [0, 1], color=TARGET, linewidth=1.0, linestyle=(0, (5, 3)))
    for colour, curve in zip(SERIES, curves, strict=False):
        level, found = consistency.calibration(curve.squares, curve.degrees, 50)
        inner.plot(level, found, color=colour)
    inner.set(xlabel="confidence level", ylabel="share of errors inside", xlim=(0, 1), ylim=(0, 1))
    inner.set_aspect("equal")
    means = [curve.mean / curve.degrees for curve in curves]
    rows = np.arange(len(curves))[::-1]
    for row, mean, colour, curve in zip(rows, means, SERIES, curves, strict=False):
        low, high = (
            bound / curve.degrees for bound in consistency.band(curve.degrees, curve.samples)
        )
        text.plot([low, high], [row, row], color=FAINT, lw=6, solid_capstyle="butt")
        text.plot(mean, row, "o", color=colour)
    text.axvline(1.0, color=TARGET, linewidth=1.0, linestyle=(0, (5, 3)))
    text.set_yticks(rows, [curve.name for curve in curves])
    for tick, colour in zip(text.get_yticklabels(), SERIES, strict=False):
        tick.set_color(colour)  # this is the legend of both
    text.set_xscale("log")
    text.set(xlabel="mean NEES (or NIS) per dimension", ylim=(-0.6, len(curves) - 0.4))
    ticks = np.array([0.01, 0.03, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 30.0, 100.0, 1000.0])
    low, high = min(*means, 0.5) * 0.8, max(*means, 2.0) * 1.25
    text.set_xlim(low, high)
    text.set_xticks(ticks[(ticks > low) & (ticks < high)])
    text.xaxis.set_major_formatter("{x:g}")
    text.xaxis.set_minor_locator(NullLocator())
    sentence = (
        "Left: share of the errors inside the confidence region of each level. A consistent estimate follows the "
        "diagonal, an over-confident one lies below it, an under-confident one above (band: 95 % interval for the "
        "curve with the fewest independent samples). Right, in the same colours: mean NEES per dimension, with its 95 % "
        "interval in grey."
    )
    return Drawn(figure, sentence)


def whiteness(run: RunFolder) -> Drawn | None:
    """Autocorrelation of the innovations; None with too few of them."""
    table = run.read_csv("innovations.csv")
    found = (
        [] if table is None else [(one, *autocorrelation(one.series)) for one in innovations(table)]
    )
    found = [entry for entry in found if len(entry[1])]
    if not found:
        return None
    figure, axes = sheet(1, 1, 2.4)
    width = 0.8 / len(found)
    for k, (one, values, bounds) in enumerate(found):
        lags = np.arange(1, len(values) + 1) + (k - (len(found) - 1) / 2) * width
        axes.bar(lags, values, width * 0.9, color=SERIES[k], label=f"{one.source}s")
        axes.plot(lags, bounds, "_", color=TRUTH, markersize=9)
        axes.plot(lags, -bounds, "_", color=TRUTH, markersize=9)
    axes.axhline(0.0, color=TRUTH, linewidth=0.7)
    axes.set(xlabel="lag, measurements", ylabel="autocorrelation")
    legend(axes)
    sentence = (
        "Autocorrelation of the innovations of each landmark or track. The innovations of a consistent filter are "
        "white: 95 % of the bars stay between the dashes."
    )
    return Drawn(figure, sentence)


def risk(run: RunFolder) -> Drawn | None:
    """Claimed probability of contact against what happened; None without a guard, movers or ground truth."""
    found = risk_of_run(run)
    if found is None:
        return None
    classes = found.classes()
    rows = np.arange(len(classes))[::-1]
    figure, axes = sheet(1, 1, 0.9 + 0.35 * len(classes))
    for row, one in zip(rows, classes, strict=True):
        axes.plot([one.low, one.high], [row, row], color=FAINT, lw=6, solid_capstyle="butt")
    axes.plot([one.happened for one in classes], rows, "o", color=TRUTH, label="happened")
    axes.plot([one.claimed for one in classes], rows, "D", color=ESTIMATE, label="claimed")
    axes.set_xscale("symlog", linthresh=0.01)
    axes.set_xticks([0.0, 0.01, 0.05, 0.2, 1.0], ["0", "1 %", "5 %", "20 %", "100 %"])
    axes.set_xlim(-0.0005, 1.0)
    axes.set_yticks(rows, [f"{one.decisions} decisions" for one in classes])
    axes.set(xlabel="probability of contact in the next 2.6 s", ylim=(-0.6, len(classes) - 0.4))
    legend(axes)
    sentence = (
        "Probability of contact with what may move that the guard claimed, in classes below 1, 5, 20 and 100 %, and the "
        "share of these decisions that such a contact followed (grey: 95 % interval). Claims are right if they lie "
        "in the interval."
    )
    return Drawn(figure, sentence)


@dataclass(frozen=True)
class _Curve:
    """Whitened errors of one estimate; infinite where it has no covariance."""

    name: str
    whitened: Float[np.ndarray, "n k"]

    @property
    def degrees(self) -> int:
        return self.whitened.shape[1]

    @property
    def squares(self) -> Float[np.ndarray, "n"]:
        return squared(self.whitened)

    @property
    def usable(self) -> Bool[np.ndarray, "n"]:
        return np.isfinite(self.squares)

    @property
    def mean(self) -> float:
        return float(np.mean(self.squares[self.usable]))

    @property
    def samples(self) -> float:
        return effective_samples(self.whitened[self.usable])


def _normalised(run: RunFolder) -> list[_Curve]:
    """Whitened errors of every estimate with ground truth, and all innovations."""
    found: list[_Curve] = []
    true = true_trajectory(run)
    pose = None if true is None else pose_errors(run, true)
    if pose is not None:
        found.append(_Curve("pose", pose[1]))
    floor, true_floor = run.read_csv("floor.csv"), run.read_csv("truth/floor.csv")
    if floor is not None and true_floor is not None:
        for camera, errors in floor_errors(floor, true_floor).items():
            found.append(_Curve(f"floor ({camera})", errors.whitened[errors.seen]))
    obstacles, truth = run.read_json("obstacles.json"), run.read_csv("truth/obstacles.csv")
    if obstacles and truth is not None:
        tracks = track_errors(obstacles["tracks"], truth)
        found.append(_Curve("moving obstacles", tracks.whitened_of(moving(truth))))
    table = run.read_csv("innovations.csv")
    for one in [] if table is None else innovations(table):
        found.append(_Curve(f"{one.source} innovations", one.whitened))
    return [curve for curve in found if np.count_nonzero(curve.usable) >= MIN_SAMPLES]
