"""Two or more versions or settings over the same recordings or seeds: what became better or worse, and what did not.

Runs are pairs if they have the same kind and the same recording (by its digest, else by its name); simulated walks if
they have the same scene and seed. Of several runs of one recording in a folder the mean is taken. Figures that are
positive are compared by their ratio, so that a difficult recording does not outweigh the others; a figure that can be
zero by its difference; NEES and NIS by how far they are from 1, either way.

Statistics: `paired`. The rate of false alarms over all figures of a comparison is 0.0025 by default: twenty
comparisons of what is equal stay silent with a probability of 95 % (Bonferroni).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from perception.primitives.errors import InputError

from ..progress import Say
from ..words import count_of
from .paired import Paired, fewest, holm, paired
from .sides import FIGURES, UNJUDGED, Figure, Side, read_side

ALARM = 0.05 / 20
WORSE, BETTER, SILENT, EQUAL = "worse", "better", "no difference shown", "equal in every pair"
MOST_CASES = 6
SHOWN = "{:.4g}"  # a figure in the page and in the terminal


@dataclass(frozen=True)
class Judged:
    """One figure of a comparison.

    Args:
        figure: Which.
        ratio: Whether differences are those of logarithms (then `change` is the ratio less 1).
        before, after: Medians of the two sides over the pairs.
        difference: Paired differences, second less first; of a figure that should be 1, of its distance from it.
        change, low, high: Typical change with its 95 % interval, as a ratio less 1 or as a difference.
        adjusted: p-value after Holm's correction; NaN for a figure that is not judged.
        verdict: "better", "worse", "no difference shown", or why there is none.
        worst: Keys of the pairs with the largest losses, the worst first; none that the digits do not show.
    """

    figure: Figure
    ratio: bool
    before: float
    after: float
    difference: Paired
    change: float
    low: float
    high: float
    adjusted: float
    verdict: str
    worst: tuple[str, ...]


@dataclass(frozen=True)
class Comparison:
    """The second side against the first.

    Args:
        first, second: The sides.
        pairs: Keys that both have.
        judged: Figures that both know.
        alarm: Rate of false alarms over all figures.
        settings: Settings that differ: name, first, second.
    """

    first: Side
    second: Side
    pairs: tuple[str, ...]
    judged: tuple[Judged, ...]
    alarm: float
    settings: tuple[tuple[str, str, str], ...]

    @property
    def found(self) -> list[Judged]:
        """Figures that became better or worse."""
        return [one for one in self.judged if one.verdict in (BETTER, WORSE)]

    @property
    def differing(self) -> list[Judged]:
        """Figures that are not equal in every pair."""
        return [one for one in self.judged if one.difference.equal < one.difference.number]

    @property
    def left_out(self) -> list[str]:
        """What only one side has, in words: recordings, and figures of pairs. What fails on one side is not compared."""
        found = []
        for one, other in ((self.first, self.second), (self.second, self.first)):
            alone = [label for key, label in one.labels.items() if key not in other.labels]
            if alone:
                found.append(
                    f"{len(alone)} of {len(one.labels)} only in {one.name} ({_some(alone)})"
                )
            for name in (figure.name for figure in FIGURES):
                keys = [
                    k for k in self.pairs if name in one.metrics[k] and name not in other.metrics[k]
                ]
                if keys:
                    some = _some([one.labels[key] for key in keys])
                    found.append(
                        f"{name} of {count_of(len(keys), 'pair')} only in {one.name} ({some})"
                    )
        return found

    @property
    def words(self) -> str:
        """The verdict in a few words."""
        count = len([one for one in self.judged if not math.isnan(one.adjusted)])
        if not self.found:
            return f"no difference shown in {count} figures; pairs: {len(self.pairs)}"
        named = [f"{one.figure.name} {one.verdict} ({shown_change(one)})" for one in self.found]
        return ", ".join(named)

    def content(self) -> dict[str, Any]:
        """For machines; infinite and unknown values are null."""
        figures = {}
        for one in self.judged:
            row = asdict(one)
            row |= {"words": one.figure.words, "pairs": one.difference.number}
            row["equal_pairs"], row["probability"] = (
                one.difference.equal,
                one.difference.probability,
            )
            del row["figure"], row["difference"]
            figures[one.figure.name] = row
        return {
            "first": self.first.name,
            "second": self.second.name,
            "pairs": len(self.pairs),
            "equal": not self.found,
            "verdict": self.words,
            "left_out": self.left_out,
            "alarm": self.alarm,
            "figures": figures,
            "settings": {name: [before, after] for name, before, after in self.settings},
        }


def compare(places: Sequence[Path], say: Say, alarm: float = ALARM) -> list[Comparison]:
    """Compare every place with the first.

    Args:
        places: At least two run folders or folders of runs.
        say: What was left out.
        alarm: Probability of calling anything different in a comparison of what is equal.

    Raises:
        InputError: A place has no runs, or two places have no pair.
    """
    sides = [read_side(place, say) for place in places]
    return [compared(sides[0], side, alarm) for side in sides[1:]]


def compared(first: Side, second: Side, alarm: float = ALARM) -> Comparison:
    """Compare two sides.

    Raises:
        InputError: They have no recording or seed in common.
    """
    pairs = tuple(key for key in first.metrics if key in second.metrics)
    if not pairs:
        raise InputError(
            f"{first.name} and {second.name} have no recording, and no scene with a seed, in common: "
            f"{_some([*first.labels.values()])} against {_some([*second.labels.values()])}"
        )
    asked = (_differences(figure, first, second, pairs) for figure in (*FIGURES, *UNJUDGED))
    known = [one for one in asked if one is not None]
    differing = [
        one for one in known if one.figure in FIGURES and one.found.equal < one.found.number
    ]
    adjusted = dict(
        zip(
            (one.figure.name for one in differing),
            holm([one.found.probability for one in differing]),
            strict=True,
        )
    )
    least = fewest(len(differing), alarm)
    return Comparison(
        first,
        second,
        pairs,
        tuple(_judged(one, adjusted, least, alarm) for one in known),
        alarm,
        _changed(first, second),
    )


@dataclass(frozen=True)
class _Differences:
    """Differences of a figure over the pairs that know it; positive ones are gains."""

    figure: Figure
    ratio: bool
    keys: tuple[str, ...]
    before: np.ndarray
    after: np.ndarray
    values: np.ndarray
    found: Paired


def _differences(
    figure: Figure, first: Side, second: Side, pairs: Sequence[str]
) -> _Differences | None:
    keys = tuple(
        key
        for key in pairs
        if figure.name in first.metrics[key] and figure.name in second.metrics[key]
    )
    if not keys:
        return None
    before, after = (
        np.array([side.metrics[key][figure.name] for key in keys]) for side in (first, second)
    )
    ratio = figure.ratio and bool(np.all(before > 0.0) and np.all(after > 0.0))
    if ratio and figure.better == 0:
        values = np.abs(np.log(after)) - np.abs(np.log(before))
    elif figure.better == 0:
        values = np.abs(after - 1.0) - np.abs(before - 1.0)
    else:
        values = np.log(after / before) if ratio else after - before
    return _Differences(figure, ratio, keys, before, after, values, paired(values))


def _judged(one: _Differences, adjusted: Mapping[str, float], least: int, alarm: float) -> Judged:
    found = one.found
    scaled: Callable[[float], float] = math.expm1 if one.ratio else float
    loss = one.values * (-1.0 if one.figure.better > 0 else 1.0)
    seen = [SHOWN.format(a) != SHOWN.format(b) for a, b in zip(one.before, one.after, strict=True)]
    order = [k for k in np.argsort(-loss, kind="stable") if loss[k] > 0.0 and seen[k]]
    chance = adjusted.get(one.figure.name, 1.0 if one.figure in FIGURES else math.nan)
    if one.figure not in FIGURES:
        verdict = "not judged"
    elif found.equal == found.number:
        verdict = EQUAL
    elif chance <= alarm:
        verdict = WORSE if (found.typical > 0.0) == (one.figure.better <= 0) else BETTER
    elif found.number - found.equal < least:
        verdict = f"too few pairs: {found.number - found.equal} differ, {least} needed"
    else:
        verdict = SILENT
    return Judged(
        one.figure,
        one.ratio,
        float(np.median(one.before)),
        float(np.median(one.after)),
        found,
        scaled(found.typical),
        scaled(found.low) if math.isfinite(found.low) else -math.inf,
        scaled(found.high) if math.isfinite(found.high) else math.inf,
        chance,
        verdict,
        tuple(one.keys[k] for k in order[:MOST_CASES]),
    )


def shown_change(one: Judged) -> str:
    """Change with its interval, in words; of a figure that should be 1, that of its distance from 1."""
    of = "distance from 1: " if one.figure.better == 0 else ""

    def text(value: float) -> str:
        return f"{100.0 * value:+.2g} %" if one.ratio else f"{value:+.3g}"

    if not math.isfinite(one.low + one.high):
        return f"{of}{text(one.change)}, no interval"
    return f"{of}{text(one.change)}, {text(one.low)} to {text(one.high)}"


def _changed(first: Side, second: Side) -> tuple[tuple[str, str, str], ...]:
    names = sorted(first.settings.keys() & second.settings.keys())
    return tuple(
        (name, first.settings[name], second.settings[name])
        for name in names
        if first.settings[name] != second.settings[name]
    )


def _some(labels: Sequence[str]) -> str:
    return ", ".join(labels[:3]) + (", ..." if len(labels) > 3 else "")
