"""Plots of a judged trajectory: the track, errors with their claimed bands, reliability, honesty over the distance."""

from __future__ import annotations

import numpy as np

from ...evaluation.referee import Verdict
from .style import ESTIMATE, FAINT, TARGET, TRUTH, WRONG, Drawn, Picture, legend, sheet, styled, svg


def pictures(verdict: Verdict) -> list[Picture]:
    """The plots of a verdict; without covariances the track alone."""
    with styled():
        drawn = [("track", "Trajectory", track(verdict))]
        if verdict.errors is not None:
            drawn.append(("errors", "Errors and claims", errors(verdict)))
            drawn.append(("honesty", "Do the claims hold?", honesty(verdict)))
        return [
            Picture(identity, title, one.sentence, svg(one.figure))
            for identity, title, one in drawn
        ]


def track(verdict: Verdict) -> Drawn:
    """Estimate and truth from above, in the axes of the truth."""
    figure, axes = sheet(1, 1, 3.6)
    true, found = verdict.truth.positions, verdict.estimate.positions
    spread = np.ptp(true, axis=0)
    across, up = sorted(np.argsort(-spread, kind="stable")[:2].tolist())
    axes.plot(true[:, across], true[:, up], color=TRUTH, label="truth")
    axes.plot(found[:, across], found[:, up], color=ESTIMATE, linewidth=1.0, label="estimate")
    axes.set(xlabel=f"{'xyz'[across]}, m", ylabel=f"{'xyz'[up]}, m")
    axes.set_aspect("equal", adjustable="datalim")
    legend(axes)
    return Drawn(
        figure, "The track along the two axes of its largest extent, in the axes of the truth."
    )


def errors(verdict: Verdict) -> Drawn:
    """Error of each component with the band of two claimed standard deviations."""
    assert verdict.errors is not None
    assert verdict.covariances is not None
    assert verdict.travelled is not None
    names = list(verdict.metrics["by_component"])
    rows = len(names) // 3
    figure, grid = sheet(rows, 3, 1.9 * rows + 0.4, sharex=True)
    sigmas = np.sqrt(np.maximum(np.diagonal(verdict.covariances, axis1=1, axis2=2), 0.0))
    for i, (name, axes) in enumerate(zip(names, np.ravel(grid), strict=True)):
        angle = name.startswith(("turn", "yaw"))
        size = 180.0 / np.pi if angle else 100.0
        band = 2.0 * size * sigmas[:, i]
        axes.fill_between(verdict.travelled, -band, band, color=TARGET, alpha=0.15, lw=0)
        axes.plot(verdict.travelled, size * verdict.errors[:, i], color=WRONG, linewidth=0.6)
        for edge in (-band, band):  # visible over dense errors
            axes.plot(verdict.travelled, edge, color=TARGET, linewidth=1.0)
        axes.set_title(f"{name.replace('_', ' ')}, {'deg' if angle else 'cm'}")
    for axes in np.atleast_2d(grid)[-1]:
        axes.set_xlabel("distance travelled, m")
    sentence = (
        "Errors, after the alignment if there is one (vermilion), and two claimed standard deviations (green). If the claims are exact, "
        "95 % of the errors lie in the band."
    )
    return Drawn(figure, sentence)


def honesty(verdict: Verdict) -> Drawn:
    """Reliability curve, and the factor between errors and claims over the distance travelled."""
    figure, (left, right) = sheet(1, 2, 3.3)
    curve = verdict.metrics["reliability"]
    level = np.linspace(0.0, 1.0, 101)
    spread = 1.96 * np.sqrt(level * (1.0 - level) / verdict.metrics["pose_effective_samples"])
    left.fill_between(level, level - spread, level + spread, color=TARGET, alpha=0.12, lw=0)
    left.plot([0, 1], [0, 1], color=TARGET, linewidth=1.0, linestyle=(0, (5, 3)), label="exact")
    left.plot(curve["levels"], curve["shares"], color=ESTIMATE, label="these claims")
    left.set(xlabel="confidence level", ylabel="share of errors inside", xlim=(0, 1), ylim=(0, 1))
    left.set_aspect("equal")
    legend(left)
    for part in verdict.metrics["by_distance"]:
        right.plot(
            [part["from_m"], part["to_m"]],
            [part["sigma_factor"]] * 2,
            color=ESTIMATE,
            linewidth=3.0,
        )
    right.axhline(1.0, color=TARGET, linewidth=1.0, linestyle=(0, (5, 3)))
    right.set_yscale("log")
    low, high = right.get_ylim()
    right.set_ylim(min(low, 0.4), max(high, 2.5))
    right.yaxis.set_major_formatter("{x:g}")
    right.yaxis.set_minor_formatter("{x:g}")
    right.tick_params(axis="y", which="minor", labelsize=7.0, labelcolor=FAINT)
    right.set(xlabel="distance travelled, m", ylabel="errors / claimed sigmas")
    sentence = (
        "Left: share of the errors inside the confidence region of each level; below the diagonal the claims are too sure, "
        "above it too careful (band: 95 % by the number of independent samples). Right: by what factor the errors "
        "differ from the claimed standard deviations; above 1 too sure."
    )
    return Drawn(figure, sentence)
