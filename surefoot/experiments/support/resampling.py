"""Confidence intervals of the figures of any experiment whose trials have seeds: bootstrap over the seeds.

The experiment is run again on its own finished trials, with the seeds drawn anew with replacement, so that its own
arithmetic makes the figures of every draw. Trials that differ in the seed alone form a group; seeds are drawn alike in
all groups, so that comparisons stay paired. A figure has no interval if the finished trials alone do not give it back
(a measured time), if it lies at the end of its interval (an extreme, or a share of exactly 0 or 1: the bootstrap
says nothing about these), or with fewer than five seeds.

Source: B. Efron, R. Tibshirani, *An introduction to the bootstrap*, 1993 (percentile interval).
"""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from typing import Any

import numpy as np

from .trials import heard_by

DRAWS = 400
LEVEL = 0.95
FEWEST = 5  # seeds; with fewer the draws repeat themselves
LONGEST_S = 60.0  # for all draws
SEED = 2026

Figures = Mapping[str, float]
Task = tuple[Any, ...]
Rank = Mapping[int, float]
"""Of each seed, in [0, 1): which seed of its group stands for it in a draw."""


@dataclass
class Record:
    """The trials of an experiment while it runs; a `Listener` that lets them run."""

    studies: list[tuple[list[Task], list[Any]]] = field(default_factory=list)
    waited_s: float = 0.0

    def known(self, todo: Sequence[Task]) -> None:
        """Nothing is known: the trials run."""

    def finished(self, todo: Sequence[Task], results: Sequence[Any], waited_s: float) -> None:
        """Keep the results."""
        self.studies.append((list(todo), list(results)))
        self.waited_s += waited_s

    @property
    def trials(self) -> int:
        """Number of all trials."""
        return sum(len(todo) for todo, _ in self.studies)


class _Replay:
    """Gives the results of a record in the order of its studies, with other seeds."""

    def __init__(self, groups: Sequence[Sequence[_Group]], record: Record, rank: Rank | None):
        self._studies = iter(
            [
                _redrawn(results, of_study, rank)
                for (_, results), of_study in zip(record.studies, groups, strict=True)
            ]
        )

    def known(self, todo: Sequence[Task]) -> Sequence[Any]:
        results = next(self._studies)
        if len(results) != len(todo):
            raise ValueError("the experiment asks for other trials than before")
        return results

    def finished(self, todo: Sequence[Task], results: Sequence[Any], waited_s: float) -> None:
        raise AssertionError("nothing runs in a replay")


@dataclass
class _Group:
    """Trials of one study that differ in the seed alone: their places in it, and their seeds."""

    places: list[int]
    seeds: list[int]


def intervals(
    run: Callable[[], Figures], record: Record, figures: Figures, seconds: float
) -> tuple[dict[str, tuple[float, float]], str]:
    """95 % intervals of the figures, and a sentence on how they were made or why there are none.

    Args:
        run: The experiment, without progress; called once for each draw.
        record: Its trials.
        figures: Its figures.
        seconds: Time that it took, its trials included.
    """
    if not record.studies:
        return {}, "no intervals: the seeds of this experiment do not run as separate trials"
    groups = [_groups(todo) for todo, _ in record.studies]
    count = max((len(one.seeds) for study in groups for one in study), default=0)
    n = f"trials: {record.trials}, seeds of each kind: at most {count}"
    if count < FEWEST:
        return {}, f"no intervals with fewer than {FEWEST} seeds; {n}"
    if DRAWS * (seconds - record.waited_s) > 20.0 * LONGEST_S:
        return {}, f"no intervals: the figures take too long to compute again; {n}"
    began_s = time.monotonic()
    again = _figures_of(run, _Replay(groups, record, None))
    if DRAWS * (time.monotonic() - began_s) > LONGEST_S:
        return {}, f"no intervals: the figures take too long to compute again; {n}"
    steady = [name for name, value in figures.items() if again.get(name, math.nan) == value]
    rng = np.random.default_rng(SEED)
    seeds = sorted({seed for study in groups for one in study for seed in one.seeds})
    drawn = []
    for _ in range(DRAWS):
        rank = dict(zip(seeds, rng.random(len(seeds)), strict=True))
        found = _figures_of(run, _Replay(groups, record, rank))
        drawn.append([found.get(name, math.nan) for name in steady])
    kept = {}
    for name, values in zip(steady, np.array(drawn).T, strict=True):
        if not np.isfinite(values).all():
            continue
        low, high = np.quantile(values, [(1.0 - LEVEL) / 2.0, (1.0 + LEVEL) / 2.0])
        if low < figures[name] < high:
            kept[name] = (float(low), float(high))
    return kept, f"{100 * LEVEL:.0f} % intervals by bootstrap over the seeds, {DRAWS} draws; {n}"


def _figures_of(run: Callable[[], Figures], replay: _Replay) -> Figures:
    """The figures of one draw; none if it has trials that the experiment cannot count with."""
    with heard_by(replay), warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        try:
            return run()
        except (ArithmeticError, ValueError, IndexError):
            return {}


def _redrawn(results: Sequence[Any], groups: Sequence[_Group], rank: Rank | None) -> list[Any]:
    """Results of a study with other seeds in every group; rank None: the same."""
    found = list(results)
    if rank is not None:
        for one in groups:
            for place, seed in zip(one.places, one.seeds, strict=True):
                found[place] = results[one.places[int(rank[seed] * len(one.places))]]
    return found


def _groups(todo: Sequence[Task]) -> list[_Group]:
    """Groups of the trials of one study, each in the order of its seeds."""
    found: dict[str, _Group] = {}
    for place, task in enumerate(todo):
        seed, rest = _seed_and_rest(task)
        if seed is not None:
            group = found.setdefault(rest, _Group([], []))
            group.places.append(place)
            group.seeds.append(seed)
    return list(found.values())


def _seed_and_rest(task: Task) -> tuple[int | None, str]:
    """The seed of a trial, and what else it depends on; the seed is its first whole number, or a field `seed`."""
    for k, value in enumerate(task):
        if isinstance(value, int) and not isinstance(value, bool) and value >= 0:
            return value, repr((*task[:k], *task[k + 1 :]))
        if is_dataclass(value) and any(one.name == "seed" for one in fields(value)):
            carrier: Any = value
            return carrier.seed, repr((*task[:k], replace(carrier, seed=0), *task[k + 1 :]))
    return None, ""
