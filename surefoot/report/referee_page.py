"""The page of a judged foreign trajectory, and its words for the terminal."""

from __future__ import annotations

import html
import shlex
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from string import Template
from typing import Any

from ..evaluation.metrics.calibration import IN_BAND
from ..evaluation.referee import Verdict
from ..results.run_folder import RunFolder
from ..results.version import commit, version
from .cards import Card
from .plots.referee import pictures
from .sections import card_item, figure_rows, plot_section

KIND = "evaluation"
PAGE = "report.html"
FILES = {
    "metrics.json": "the figures of this page",
    "errors.csv": "stamp, distance travelled, errors and claimed standard deviations of each pose",
    "figures/track.svg": "the plots of this page as files, in figures/",
}


def write_page(folder: RunFolder, verdict: Verdict, command: Sequence[str]) -> Path:
    """Write metrics.json, summary.json, errors.csv, the plots and report.html.

    Raises:
        OutputError: The folder cannot be written.
    """
    metrics = verdict.metrics
    folder.write_json("metrics.json", metrics)
    folder.write_json(
        "summary.json",
        {
            "kind": KIND,
            "name": folder.root.name,
            "command": shlex.join(command),
            "version": version(),
            "commit": commit(),
        },
    )
    _write_errors(folder, verdict)
    drawn = pictures(verdict)
    for picture in drawn:
        folder.write_bytes(f"figures/{picture.identity}.svg", picture.svg)
    words, good = headline(metrics)
    page = Template(resources.files(__package__).joinpath("report_page.html").read_text("utf-8"))
    subtitle = [f"{metrics['format']} against {metrics['truth_format']}"]
    subtitle += [
        str(metrics[key]) for key in ("left_out", "doubt", "covariances", "note") if key in metrics
    ]
    text = page.substitute(
        title="Trajectory against truth",
        subtitle=html.escape(" · ".join(subtitle)),
        verdict=html.escape(words),
        replay="",
        verdict_class="none" if good is None else "good" if good else "bad",
        cards="\n".join(card_item(card) for card in _cards(metrics)),
        sections="\n".join(plot_section(picture) for picture in drawn),
        command=html.escape(
            f"{shlex.join(command)}\nsurefoot view {shlex.quote(str(folder.root))}"
        ),
        files="\n".join(
            f"<tr><td><code>{name}</code></td><td>{meaning}</td></tr>"
            for name, meaning in FILES.items()
            if folder.has(name)
        ),
        numbers="\n".join(
            figure_rows({k: v for k, v in metrics.items() if not isinstance(v, (dict, list))})
        ),
    )
    return folder.write_text(PAGE, text)


def _short(number: float, digits: int = 2) -> str:
    """A number with these decimals; a large one in scientific notation."""
    return f"{number:.{digits}f}" if abs(number) < 1e4 else f"{number:.3g}"


def headline(metrics: dict[str, Any]) -> tuple[str, bool | None]:
    """The verdict on the covariances in a few words, and whether it is good; None without covariances."""
    if "verdict" not in metrics:
        return "no covariances to judge", None
    if metrics["verdict"] == IN_BAND:
        return "the covariances hold", True
    return f"{metrics['verdict']} by a factor of {_short(metrics['factor'], 1)} in sigma", False


def lines(metrics: dict[str, Any]) -> list[str]:
    """The verdict for the terminal."""
    shown = [
        f"{metrics['matched_poses']:.0f} of {metrics['poses']:.0f} poses compared "
        f"({metrics['format']} against {metrics['truth_format']}){_left_out(metrics)}",
        *([f"doubt: {metrics['doubt']}"] if "doubt" in metrics else []),
        f"position error (RMS): {metrics['position_rmse_3d_m']:.4f} m as it stands{_after(metrics)}",
        f"positions alone are compared: no rotations in {metrics['without_rotations']}"
        if "without_rotations" in metrics
        else f"RPE (RMS): {metrics['rpe_frame_m']:.4f} m, {metrics['rpe_frame_deg']:.3f} deg from pose to pose",
    ]
    if "verdict" not in metrics:
        return [*shown, str(metrics["note"])]
    shown += [
        str(metrics["covariances"]),
        f"claims: {headline(metrics)[0]}; mean NEES {_short(metrics['pose_anees'])}, {metrics['pose_dof']:.0f} if exact, "
        f"95 % band {_short(metrics['pose_anees_low'])} to {_short(metrics['pose_anees_high'])} "
        f"({metrics['pose_effective_samples']:.0f} independent samples)",
    ]
    shown += [
        f"  {name:<7} {one['verdict']}" + _by(one) for name, one in metrics["by_component"].items()
    ]
    shown += [
        f"  {part['from_m']:6.2f} to {part['to_m']:6.2f} m  {part['verdict']}{_by(part)}"
        for part in metrics["by_distance"]
    ]
    if "motions" in metrics:
        one = metrics["motions"]
        shown.append(f"  {one['number']:.0f} motions between poses: {one['verdict']}{_by(one)}")
    crps = [
        f"{metrics[f'crps_{unit}']:.4g} {unit}"
        for unit in ("m", "deg")
        if f"crps_{unit}" in metrics
    ]
    shown.append(f"CRPS: {', '.join(crps)} (mean of the components)")
    if "inflation" in metrics:
        shown.append(
            f"90 % regions of {'motions' if 'motions' in metrics else 'poses'}, second half: {metrics['coverage_claimed']:.0%} inside as claimed, "
            f"{metrics['coverage_inflated']:.0%} with sigmas times {_short(metrics['inflation'])}, "
            f"{metrics['coverage_conformal']:.0%} with the conformal radius {_short(metrics['conformal_radius'])} "
            f"(exact: {metrics['gaussian_radius']:.2f}), both fitted on the first half"
        )
    return shown


def _left_out(metrics: dict[str, Any]) -> str:
    return f": {metrics['left_out']}" if "left_out" in metrics else ""


def _after(metrics: dict[str, Any]) -> str:
    names = (("ate_m", "aligned (ATE)"), ("ate_scaled_m", "aligned with scale"))
    return "".join(f", {metrics[key]:.4f} m {words}" for key, words in names if key in metrics)


def _by(one: dict[str, Any]) -> str:
    return "" if one["verdict"] == IN_BAND else f" by a factor of {_short(one['factor'], 1)}"


def _cards(metrics: dict[str, Any]) -> list[Card]:
    found = [Card("Poses compared", f"{metrics['matched_poses']:.0f}", metrics["format"])]
    if "ate_m" in metrics:
        found.append(
            Card("Trajectory error (ATE)", f"{metrics['ate_m']:.4f} m", "RMS after alignment")
        )
    else:
        shown = f"{metrics['position_rmse_3d_m']:.4f} m"
        found.append(Card("Position error", shown, "RMS as it stands"))
    if "rpe_frame_m" in metrics:
        found.append(
            Card("Relative error (RPE)", f"{metrics['rpe_frame_m']:.4f} m", "RMS, pose to pose")
        )
    if "verdict" in metrics:
        note = f"exact: {metrics['pose_dof']:.0f}; {_short(metrics['pose_anees_low'])} to {_short(metrics['pose_anees_high'])}"
        met = metrics["verdict"] == IN_BAND
        found.append(Card("Mean NEES", f"{_short(metrics['pose_anees'])}", note, met))
        found.append(Card("Errors / sigmas", f"{_short(metrics['sigma_factor'])}", "1 if exact"))
        found.append(Card("CRPS", f"{metrics['crps_m']:.4f} m", "position, mean of the axes"))
    if "coverage_conformal" in metrics:
        shown = f"{metrics['coverage_claimed']:.0%} / {metrics['coverage_conformal']:.0%}"
        note = "second half, as claimed / conformal from the first"
        found.append(Card("Inside 90 % regions", shown, note))
    return found


def _write_errors(folder: RunFolder, verdict: Verdict) -> None:
    if verdict.errors is None or verdict.covariances is None or verdict.rows is None:
        return
    assert verdict.travelled is not None
    names = list(verdict.metrics["by_component"])
    header = (
        "stamp_s", "travelled_m", *(f"error_{n}" for n in names), *(f"sigma_{n}" for n in names),
    )  # fmt: skip
    sigmas = (verdict.covariances.diagonal(axis1=1, axis2=2).clip(min=0.0)) ** 0.5
    stamps = verdict.truth.stamps[verdict.rows]
    rows = [
        (float(t), float(d), *e, *s)
        for t, d, e, s in zip(
            stamps, verdict.travelled, verdict.errors.tolist(), sigmas.tolist(), strict=True
        )
    ]
    folder.write_csv("errors.csv", header, rows)
