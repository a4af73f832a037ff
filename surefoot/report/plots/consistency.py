"""Pictures of trust: can a covariance of this run be believed?

Errors in units of their own covariance, the shares of errors inside each confidence region, and whether
one surprise foretells the next. Plan views and curves over time are in `plots_plan` and `plots`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from perception.filtering import consistency

from ...evaluation.evaluate import pose_errors
from ...evaluation.metrics.consistency import band, effective_samples, squared
from ...evaluation.metrics.floor import floor_errors
from ...evaluation.metrics.innovations import autocorrelation, innovations
from ...evaluation.metrics.obstacles import moving, track_errors
from ...results.run_folder import RunFolder
from .style import BELIEF, FAINT, SERIES, TRUTH, WANTED, WRONG, Drawn, key, sheet

LEAST = 20  # samples below which a curve says nothing


def nees_over_time(run: RunFolder) -> Drawn | None:
    """NEES of the pose with its band; None without truth or covariance."""
    true = run.read_trajectory("truth/trajectory.txt")
    claims = None if true is None else pose_errors(run, true)
    if claims is None:
        return None
    stamps, values = claims[0], squared(claims[1])
    low, high = band(3)
    figure, axes = sheet(1, 1, 2.5)
    axes.axhspan(low, high, color=WANTED, alpha=0.12, lw=0, label="95 % band")
    axes.axhline(3.0, color=WANTED, linewidth=1.0, linestyle=(0, (5, 3)), label="expected mean")
    bottom = low / 5
    finite = np.where(np.isfinite(values), np.maximum(values, 1.05 * bottom), np.nan)
    inside = (values >= low) & (values <= high)
    seconds = stamps - stamps[0]
    axes.plot(seconds, finite, color=BELIEF, linewidth=0.8, alpha=0.5)
    axes.scatter(seconds[inside], finite[inside], s=7, color=BELIEF, label="inside", zorder=3)
    axes.scatter(
        seconds[~inside], finite[~inside], s=12, color=WRONG, marker="x", linewidths=0.9,
        label="outside", zorder=3,
    )  # fmt: skip
    axes.set_yscale("log")
    axes.set_ylim(bottom, max(high * 2, float(np.nanmax(np.append(finite, high))) * 1.3))
    axes.set(xlabel="time, s", ylabel="NEES of x, y, yaw")
    key(axes)
    sentence = (
        "The squared error of the pose in units of its own covariance; of an honest estimate 95 % of the points "
        "lie in the band, and the mean is 3. Above is over-confident, below is timid."
    )
    return Drawn(figure, sentence)


def calibration(run: RunFolder) -> Drawn | None:
    """Shares of errors inside each confidence region, one curve per estimate; None without any."""
    curves = _normalised(run)
    if not curves:
        return None
    from matplotlib.ticker import NullLocator

    figure, axes = sheet(1, 2, 3.4)
    inner, text = axes
    effective = min(curve.samples for curve in curves)
    claimed = np.linspace(0.0, 1.0, 101)
    spread = 1.96 * np.sqrt(claimed * (1.0 - claimed) / effective)
    inner.fill_between(claimed, claimed - spread, claimed + spread, color=WANTED, alpha=0.12, lw=0)
    inner.plot([0, 1], [0, 1], color=WANTED, linewidth=1.0, linestyle=(0, (5, 3)))
    for colour, curve in zip(SERIES, curves, strict=False):
        level, found = consistency.calibration(curve.squares, curve.degrees, 50)
        inner.plot(level, found, color=colour, label=curve.name)
    inner.set(xlabel="claimed", ylabel="found", xlim=(0, 1), ylim=(0, 1))
    inner.set_aspect("equal")
    means = [curve.mean / curve.degrees for curve in curves]
    rows = np.arange(len(curves))[::-1]
    for row, mean, colour, curve in zip(rows, means, SERIES, curves, strict=False):
        low, high = (bound / curve.degrees for bound in band(curve.degrees, curve.samples))
        text.plot([low, high], [row, row], color=FAINT, lw=6, solid_capstyle="butt")
        text.plot(mean, row, "o", color=colour)
    text.axvline(1.0, color=WANTED, linewidth=1.0, linestyle=(0, (5, 3)))
    text.set_yticks(rows, [curve.name for curve in curves])
    text.set_xscale("log")
    text.set(xlabel="mean normalised error squared per dimension", ylim=(-0.6, len(curves) - 0.4))
    ticks = np.array([0.01, 0.03, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 30.0, 100.0, 1000.0])
    low, high = min(*means, 0.5) * 0.8, max(*means, 2.0) * 1.25
    text.set_xlim(low, high)
    text.set_xticks(ticks[(ticks > low) & (ticks < high)])
    text.xaxis.set_major_formatter("{x:g}")
    text.xaxis.set_minor_locator(NullLocator())
    sentence = (
        "Left: of a region that claims to hold a share of the errors, the share it held; an honest estimate "
        "follows the diagonal, below it is over-confident, above timid (band: chance, for the curve with the "
        "fewest independent samples). Right: the mean, with the grey band in which chance leaves it 95 % of the time."
    )
    return Drawn(figure, sentence)


def whiteness(run: RunFolder) -> Drawn | None:
    """Correlation of surprises with later ones; None where there are too few."""
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
    axes.set(xlabel="sightings later", ylabel="correlation")
    key(axes)
    sentence = (
        "How much a sighting's surprise foretells that of the same landmark or track some sightings later. Of a "
        "filter that has modelled everything lasting, 95 % of the bars stay between the dashes."
    )
    return Drawn(figure, sentence)


@dataclass(frozen=True)
class _Curve:
    """One estimate's errors, in units of their own covariance, infinite where there was none."""

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
    """Every estimate that can be judged."""
    found: list[_Curve] = []
    true = run.read_trajectory("truth/trajectory.txt")
    claims = None if true is None else pose_errors(run, true)
    if claims is not None:
        found.append(_Curve("pose", claims[1]))
    floor, true_floor = run.read_csv("floor.csv"), run.read_csv("truth/floor.csv")
    if floor is not None and true_floor is not None:
        for camera, errors in floor_errors(floor, true_floor).items():
            found.append(_Curve(f"floor ({camera})", errors.whitened[errors.seen]))
    obstacles, truth = run.read_json("obstacles.json"), run.read_csv("truth/obstacles.csv")
    if obstacles and truth is not None:
        tracks = track_errors(obstacles["tracks"], truth)
        found.append(_Curve("movers", tracks.whitened_of(moving(truth))))
    table = run.read_csv("innovations.csv")
    for one in [] if table is None else innovations(table):
        found.append(_Curve(f"sightings of {one.source}s", one.whitened))
    return [curve for curve in found if np.count_nonzero(curve.usable) >= LEAST]
