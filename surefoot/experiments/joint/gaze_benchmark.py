"""A benchmark of gaze policies: the same courses and homes, the same body, planner and perception, another gaze.

Policies: a fixed head, a sweep, random, coverage, information gain, seed 001's as published, ours, an oracle that
knows where the movers are and what is hidden, and anybody's (`--gaze package.module:Class`). The walks are those of
INT-2 (`gaze_coupling`). Figures are means over the walks with 90 % intervals by bootstrap.

"Gap closed" is, for the deviation of the robot's position, the error of movers nearby and the share of stale ground,
(fixed - policy) / (fixed - oracle), at most 1 each, in the mean over the three and both scenes. The error of the
position hardly depends on the gaze (gait and landmarks decide it), so it does not count; `gap_closed_with_error` is our
share with it in place of the deviation. That choice was made after three walks of each policy had been seen. A figure
in which the oracle is no better than a fixed head has no gap and does not count either.

Of the policies nothing was chosen on the seeds from 200 on, which are walked here; INT-2 walks those from 0.

Source: ours; Yoo and Kim 2010 (seed 001) for the published policy.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from perception.primitives import plugins
from planning.gaze.policy import POLICIES

from ...evaluation.metrics.averages import mean
from ...report.plots import style
from ..support.experiment import Experiment, Outcome, Say, Target
from ..support.trials import run_all
from .gaze_coupling import LIMIT_S, GazeWalk, walk_with_gaze

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SCENES = ("course", "home")
OWN = f"{__package__}.gaze_baselines:"
MODES = {
    "fixed": "fixed",
    "sweep": "sweep",
    "random": f"{OWN}RandomGaze",
    "coverage": f"{OWN}CoverageGaze",
    "information": f"{OWN}InformationGaze",
    "seed 001": "seed",
    "ours": "evaluations",
    "oracle": f"{OWN}OracleGaze",
}
"""Name in the table to gaze policy."""
JUDGED = ("sigma_m", "mover_error_m", "stale")
COLUMNS = {
    "error_m": ("pose error, mm", 1e3),
    "sigma_m": ("pose deviation, mm", 1e3),
    "mover_error_m": ("mover error, mm", 1e3),
    "stale": ("stale ground, %", 1e2),
    "contacts": ("contacts a walk", 1.0),
    "time_s": ("time, s", 1.0),
    "travel_rad": ("head travel, rad", 1.0),
}
SAID = "Means over the walks of each gaze policy with 90 % intervals; less is better."
FIRST_SEED = 200
DRAWS = 2000

Values = Float[np.ndarray, "walks"]


def interval(values: Values, rng: np.random.Generator) -> tuple[float, float, float]:
    """Mean of the finite values, and its 90 % interval by bootstrap; NaN without any."""
    known = values[np.isfinite(values)]
    if not len(known):
        return np.nan, np.nan, np.nan
    drawn = known[rng.integers(0, len(known), (DRAWS, len(known)))].mean(axis=1)
    low, high = np.quantile(drawn, [0.05, 0.95])
    return float(known.mean()), float(low), float(high)


def gap_closed(
    means: dict[tuple[str, str, str], float], name: str, judged: tuple[str, ...] = JUDGED
) -> float:
    """Share of the gap between fixed head and oracle that a policy closes; NaN where there is no gap.

    Args:
        means: By scene, policy and figure.
        name: Of the policy.
        judged: Figures that count.
    """
    shares = []
    for scene in SCENES:
        for figure in judged:
            worst, best = means[scene, "fixed", figure], means[scene, "oracle", figure]
            if best < worst:
                shares.append(min((worst - means[scene, name, figure]) / (worst - best), 1.0))
    return mean(shares)


def draw(found: dict[tuple[str, str, str], tuple[float, float, float]], names: list[str]) -> Figure:
    """Every judged figure of every policy with its interval, one panel a figure, both scenes."""
    figure, panels = style.sheet(1, len(JUDGED), height_in=3.8)
    for axes, name in zip(panels, JUDGED, strict=True):
        title, unit = COLUMNS[name]
        for shift, (scene, colour) in enumerate(zip(SCENES, style.SERIES, strict=False)):
            rows = np.arange(len(names)) + 0.3 * shift - 0.15
            mean, low, high = unit * np.array([found[scene, one, name] for one in names]).T
            axes.hlines(rows, low, high, color=colour)
            axes.plot(mean, rows, "o", color=colour, label=scene)
        axes.set_yticks(range(len(names)), names if axes is panels[0] else [""] * len(names))
        axes.set_ylim(len(names) - 0.5, -0.5)
        axes.set_xlim(0.0, 1.05 * axes.get_xlim()[1])
        axes.set_xlabel(title)
    style.legend(panels[0])
    return figure


def run(seeds: int, say: Say, own: str = "", limit_s: float = LIMIT_S) -> Outcome:
    """Two walks per policy and seed; about three seconds of one core each.

    Args:
        seeds: Number of courses, and of homes.
        say: Takes lines of progress.
        own: The user's own gaze policy, "package.module:Class", beside ours; empty: none.
        limit_s: Longest walk.
    """
    modes = dict(MODES)
    if own:
        plugins.load(own, POLICIES, "gaze policy", ("next",))  # refused before the first walk
        modes[plugins.label(own)] = own
    keys = [
        (scene, name, k)
        for k in range(FIRST_SEED, FIRST_SEED + seeds)
        for scene in SCENES
        for name in modes
    ]
    todo = [(seed, modes[name], "kinematic", scene, limit_s) for scene, name, seed in keys]
    walks: dict[tuple[str, str], list[GazeWalk]] = {}
    for key, one in zip(keys, run_all(walk_with_gaze, todo, say, "walks"), strict=True):
        walks.setdefault(key[:2], []).append(one)
    rng = np.random.default_rng(0)
    found = {
        (*key, figure): interval(np.array([float(getattr(w, figure)) for w in many]), rng)
        for key, many in walks.items()
        for figure in COLUMNS
    }
    means = {key: one[0] for key, one in found.items()}
    names = list(modes)
    figures = {f"gap_closed_{name.replace(' ', '_')}": gap_closed(means, name) for name in names}
    figures["gap_closed_share"] = gap_closed(means, "ours")
    figures["gap_closed_with_error"] = gap_closed(means, "ours", ("error_m", *JUDGED[1:]))
    table = [
        "policy        scene   "
        + "  ".join(f"{t:>22}" for t, _ in COLUMNS.values())
        + "  gap closed"
    ]
    for name in names:
        for scene in SCENES:
            cells = []
            for figure, (_, unit) in COLUMNS.items():
                mean, low, high = (unit * value for value in found[scene, name, figure])
                cells.append(f"{mean:8.2f} ({low:.2f}-{high:.2f})".rjust(22))
                figures[f"{figure}_{scene}_{name.replace(' ', '_')}"] = mean / unit
            share = f"{figures['gap_closed_' + name.replace(' ', '_')]:10.2f}"
            table.append(f"{name:<12.12}  {scene:<6}  " + "  ".join(cells) + f"  {share}")
    drawing = style.Drawing("policies", SAID, partial(draw, found, names))
    return Outcome(figures, table, drawings=[drawing])


EXPERIMENT = Experiment(
    id="gaze-benchmark",
    title="Eight gaze policies, and yours, on the same courses and homes, with intervals and an oracle",
    run=run,
    plug_in="gaze",
    targets={"gap_closed_share": Target(">=", 0.7)},
    seeds=20,
)
