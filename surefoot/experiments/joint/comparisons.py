"""What `surefoot compare` can tell: a change of 2 % in the trajectory error, and that what is equal is equal.

Two sides run the same sequences. A sequence has its own difficulty: the error of the trajectory (ATE) is 3 cm, times or
divided by 2.2 (log-normal, 0.8), as different as real sequences are. Each run scatters about that by 0.5 % (log-normal):
other seeds of our odometry move the ATE of two sequences of 7-Scenes by 0.01 and 0.06 %, and that of walks whose poses
come from steps and landmarks not at all. One run in forty goes astray, by a factor of about three. Five more figures share most
of their scatter with the ATE, three have their own, two are counts. Planted: the second side's ATE is 2 %
larger. A/A: both sides are drawn from the same distribution.

`found` and `equal` count comparisons of 40 sequences: planted changes that are called worse, and A/A comparisons
in which no figure at all is called different. The rates are over ten times as many draws with other seeds: of false alarms
in A/A comparisons, and of 95 % intervals that hold the planted change. `t_test_found` is the share that a paired t-test on
the logarithms finds at the same level, as a peer: runs that go astray take its power. `smallest_at_1_percent` is the
change that is found nine times of ten if runs scatter by 1 %, `found_share_at_1_percent` how often the planted change is.
The targets hold at a scatter of 0.5 % alone: the study began with 2 %, where a change of 2 % is mostly not found.

The test was chosen on seeds below 2000 (Wilcoxon's, without winsorised ranks, found 19 of 20 there); this reports on seeds
from 5000 on.

Source: ours; the statistics: see `surefoot.store.paired`.
"""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy import stats

from ...report.plots import style
from ...store.comparison import ALARM, WORSE, Judged, compared
from ...store.paired import probability
from ...store.sides import Side
from ..support.experiment import Experiment, Outcome, Say, Target

SEQUENCES = 40
PLANTED = 0.02
MEDIAN_M, DIFFICULTY = 0.03, 0.8
SCATTER = 0.005
ASTRAY, ASTRAY_FACTOR, ASTRAY_SCATTER = 1 / 40, 3.0, 0.5
ALIKE = 0.8  # share of the ATE's scatter in the five figures that go with it
WITH_ATE = ("position_rmse_m", "heading_rmse_deg", "rpe_1s_m", "pose_nees", "tilt_error_deg")
OWN = ("ospa_m", "landmark_nis", "track_nis")
COUNTS = ("false_movers", "contacts")
MORE_DRAWS = 10
FIRST_SEED = 5000  # of the judged draws
SCATTERS = (0.005, 0.01, 0.02)
CHANGES = np.linspace(0.0, 0.05, 11)
POWER = 0.9


def side(seed: int, which: int, change: float = 0.0, scatter: float = SCATTER) -> Side:
    """The runs of one side over the sequences of a seed.

    Args:
        seed: Of the sequences, and with `which` of the scatter.
        which: 0 or 1, the side.
        change: Relative change of its ATE.
        scatter: Standard deviation of the logarithm from run to run.
    """
    hard = np.random.default_rng([seed, 7]).normal(0.0, DIFFICULTY, SEQUENCES)
    rng = np.random.default_rng([seed, which])
    noise = scatter * rng.normal(size=SEQUENCES)
    astray = rng.random(SEQUENCES) < ASTRAY
    noise += astray * (math.log(ASTRAY_FACTOR) + ASTRAY_SCATTER * rng.normal(size=SEQUENCES))
    values = {"ate_m": (1.0 + change) * MEDIAN_M * np.exp(hard + noise)}
    for name in (*WITH_ATE, *OWN):
        shared = ALIKE if name in WITH_ATE else 0.0
        own = scatter * rng.normal(size=SEQUENCES)
        values[name] = np.exp(hard + shared * noise + (1.0 - shared) * own)
    for name in COUNTS:
        values[name] = rng.poisson(0.2, SEQUENCES).astype(float)
    keys = [f"sequence {k}" for k in range(SEQUENCES)]
    rows = {key: {name: float(v[k]) for name, v in values.items()} for k, key in enumerate(keys)}
    same = {key: key for key in keys}
    return Side(f"side {which}", Path(f"side-{which}"), (), rows, same, same, {})


def ate(seed: int, change: float) -> Judged:
    """How the ATE is judged if the second side's is changed."""
    judged = compared(side(seed, 0), side(seed, 1, change)).judged
    return next(one for one in judged if one.figure.name == "ate_m")


def t_test(seed: int, change: float) -> bool:
    """Whether a paired t-test of the logarithms finds the change, with Bonferroni's correction over the figures."""
    first, second = (
        np.array([row["ate_m"] for row in one.metrics.values()])
        for one in (side(seed, 0), side(seed, 1, change))
    )
    figures = 1 + len(WITH_ATE) + len(OWN) + len(COUNTS)
    found = stats.ttest_rel(np.log(second), np.log(first))
    return bool(found.pvalue <= ALARM / figures and found.statistic > 0.0)


def run(seeds: int, say: Say) -> Outcome:
    """Planted and A/A comparisons of n draws, and rates over ten times as many."""
    judged = range(FIRST_SEED, FIRST_SEED + seeds)
    more = range(judged.stop, judged.stop + MORE_DRAWS * seeds)
    planted = [ate(seed, PLANTED) for seed in judged]
    equal = [not compared(side(seed, 0), side(seed, 1)).found for seed in judged]
    say("rates over more draws")
    alarms = [bool(compared(side(seed, 0), side(seed, 1)).found) for seed in more]
    others = [ate(seed, PLANTED) for seed in more]
    powers = {scatter: _powers(scatter, more, say) for scatter in SCATTERS}
    figures = {
        "found": float(sum(one.verdict == WORSE for one in planted)),
        "equal": float(sum(equal)),
        "comparisons": float(seeds),
        "missed": float(sum(one.verdict != WORSE for one in planted)),
        "false_alarms": float(seeds - sum(equal)),
        "false_alarm_rate": float(np.mean(alarms)),
        "found_share": float(np.mean([one.verdict == WORSE for one in others])),
        "interval_coverage": float(np.mean([one.low <= PLANTED <= one.high for one in others])),
        "interval_width": float(np.median([one.high - one.low for one in others])),
        "t_test_found_share": float(np.mean([t_test(seed, PLANTED) for seed in more])),
    }
    for scatter, found in powers.items():
        reached = CHANGES[np.flatnonzero(found >= POWER)]
        at = f"at_{100 * scatter:g}_percent".replace(".", "_")
        figures[f"smallest_{at}"] = float(reached[0]) if len(reached) else math.nan
        figures[f"found_share_{at}"] = float(found[np.argmin(np.abs(CHANGES - PLANTED))])
    table = [
        f"{seeds} comparisons of {SEQUENCES} sequences: change of {PLANTED:.0%} found {figures['found']:.0f} times, equal "
        f"sides called equal {figures['equal']:.0f} times",
        f"{len(more)} more: found {figures['found_share']:.1%} (paired t-test {figures['t_test_found_share']:.1%}), false "
        f"alarms {figures['false_alarm_rate']:.2%}, 95 % intervals hold the change {figures['interval_coverage']:.1%}",
    ]
    return Outcome(figures, table, drawings=[_drawing(powers)])


def _powers(scatter: float, seeds: range, say: Say) -> np.ndarray:
    """Share of the planted changes that are found, one for each of `CHANGES`, with the ATE's level among all figures."""
    say(f"power at a scatter of {100 * scatter:g} %")
    figures = 1 + len(WITH_ATE) + len(OWN) + len(COUNTS)
    shares = []
    for change in CHANGES:
        found = 0
        for seed in seeds:
            first, second = side(seed, 0, scatter=scatter), side(seed, 1, change, scatter)
            logs = [
                np.log([row["ate_m"] for row in one.metrics.values()]) for one in (first, second)
            ]
            apart = logs[1] - logs[0]
            found += bool(np.median(apart) > 0.0 and figures * probability(apart) <= ALARM)
        shares.append(found / len(seeds))
    return np.array(shares)


def _drawing(powers: dict[float, np.ndarray]) -> style.Drawing:
    def draw() -> Figure:
        figure, axes = style.sheet(height_in=3.2)
        for colour, (scatter, found) in zip(style.SERIES, powers.items(), strict=False):
            label = f"scatter {100 * scatter:g} % from run to run"
            axes.plot(100.0 * CHANGES, found, ".-", color=colour, label=label)
        style.bound(axes, POWER, "nine of ten")
        axes.set_xlabel("planted change of the trajectory error, %")
        axes.set_ylabel("share found")
        style.legend(axes)
        return figure

    sentence = f"Changes that are found over {SEQUENCES} sequences, at {ALARM:g} false alarms a comparison."
    return style.Drawing("power", sentence, partial(draw))


EXPERIMENT = Experiment(
    id="compare",
    title="surefoot compare: a change of 2 % over 40 sequences is found, and equal sides are equal",
    run=run,
    targets={
        "missed": Target("==", 0.0),
        "false_alarms": Target("==", 0.0),
        "false_alarm_rate": Target("<=", 0.01),
        "interval_coverage": Target(">=", 0.9),
    },
    seeds=20,
)
