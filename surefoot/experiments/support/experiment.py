"""The parts of an experiment: measured figures, targets, published numbers, and the registry of all experiments."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

from perception.primitives.errors import InputError

from ...progress import Say as Say  # experiments take it from here
from ...report.plots.style import Drawing
from ...results import registry
from .columns import Row, three_columns

COMPARE: dict[str, Callable[[float, float], bool]] = {
    "<=": operator.le,
    ">=": operator.ge,
    "<": operator.lt,
    ">": operator.gt,
    "==": operator.eq,
}

FILES = {
    "000-E1": "seed_000.monocular_cycle",
    "000-E2": "seed_000.swarm_table",
    "000-E3": "seed_000.robots_room",
    "000-E4": "seed_000.narrow_course",
    "000-E5": "seed_000.monocular_time",
    "001-E1": "seed_001.field_portrait",
    "001-E2": "seed_001.gaze_map",
    "001-E3": "seed_001.moving_courses",
    "001-E4": "seed_001.course_ablation",
    "001-hard": "seed_001.hard_courses",
    "003-E1": "seed_003.floor_range",
    "003-E2": "seed_003.stereo_range",
    "003-E3": "seed_003.grid_shift",
    "003-E4": "seed_003.path_search",
    "003-E5": "seed_003.path_smoothing",
    "003-E6": "seed_003.wandering",
    "003-E7": "seed_003.texture_limit",
    "003-walls": "seed_003.walls",
    "004-E1": "seed_004.obstacle_sizes",
    "004-E2": "seed_004.fuzzy_choice",
    "004-E3": "seed_004.avoidance_walks",
    "004-E4": "seed_004.avoidance_pictures",
    "004-E5": "seed_004.panorama_angles",
    "004-features": "seed_004.feature_study",
    "INT-1": "joint.people_home",
    "INT-2": "joint.gaze_coupling",
    "INT-3": "joint.floor_methods",
    "INT-4": "joint.four_planners",
    "batch": "joint.batch",
    "building": "joint.building",
    "compare": "joint.comparisons",
    "crowd": "joint.crowd",
    "faults": "joint.faults",
    "footholds": "joint.footholds",
    "gaze-benchmark": "joint.gaze_benchmark",
    "home": "joint.home",
    "localisation": "joint.localisation",
    "prediction": "joint.prediction",
    "robots": "joint.robots",
    "sensors": "joint.sensors",
    "stairs-perception": "joint.stairs_perception",
    "stairs-walk": "joint.stairs_walk",
    "storeys": "joint.storeys",
    "strangers": "joint.strangers",
    "two-physics": "joint.two_physics",
    "walking": "joint.walking",
    "mrclam": "real.mrclam",
    "real-floor": "real.floors",
    "real-ground": "real.colour_floor",
    "real-honesty": "real.honesty",
    "real-mapping": "real.surface",
    "real-odometry": "real.odometry",
    "real-panorama": "real.panorama",
    "real-planes": "real.labelled_floors",
    "real-stereo": "real.stereo",
    "referee": "real.referee",
    "sessions": "real.sessions",
}
"""Id of the specification to module, sorted by room."""

BODIES = ("kinematic", "dynamic")
"""Kinematic: exact footsteps with random slip. Dynamic: servos, soles and gravity."""


@dataclass(frozen=True)
class Target:
    """A bound on a figure: met if `figure <relation> bound`."""

    relation: str
    bound: float

    def met_by(self, figure: float) -> bool:
        """Whether the figure satisfies the bound; NaN never does."""
        return bool(COMPARE[self.relation](figure, self.bound))


@dataclass(frozen=True)
class Outcome:
    """Result of an experiment.

    Args:
        figures: Name to value.
        table: Formatted lines; may be empty.
        columns: Rows of the table paper, its method here, ours (`support.columns`).
        drawings: Pictures of the result, the main one first; all figures are drawn beside them.
    """

    figures: dict[str, float]
    table: list[str] = field(default_factory=list)
    columns: Sequence[Row] = ()
    drawings: Sequence[Drawing] = ()


Part = tuple[dict[str, float], list[str]]
"""Figures and table lines of a part of an experiment."""


def combined(*parts: Part) -> Outcome:
    """The figures and the table lines of all parts, in order."""
    figures = {name: value for found, _ in parts for name, value in found.items()}
    return Outcome(figures, [line for _, lines in parts for line in lines])


@dataclass(frozen=True)
class Experiment:
    """One experiment.

    Args:
        id: Id of the specification, such as "003-E1".
        title: Contents in one line.
        run: Called with the number of seeds, a progress callback and, if a robot walks, the body.
        targets: Bounds by name of the figure.
        published: Numbers of the paper by name of the figure.
        seeds: Default number of seeds.
        body: Default body, one of `BODIES`; empty if no robot walks.
        plug_in: Kind of the user's own class that `run` takes as `own`, "planner" or "gaze"; empty: none.
    """

    id: str
    title: str
    run: Callable[..., Outcome]
    targets: Mapping[str, Target]
    published: Mapping[str, float] = field(default_factory=dict)
    seeds: int = 10
    body: str = ""
    plug_in: str = ""


def names() -> list[str]:
    """All ids, in the order of the registry."""
    return list(FILES)


def load(identity: str) -> Experiment:
    """The experiment with this id.

    Raises:
        InputError: Unknown id; the message suggests the nearest one.
    """
    found: Experiment = registry.load("experiment", "surefoot.experiments", FILES, identity)
    return found


def with_own(experiment: Experiment, kind: str, name: str) -> Experiment:
    """The same with a plug-in of the user's own in the table beside ours.

    Args:
        experiment: Which.
        kind: "planner" or "gaze".
        name: "package.module:Class".

    Raises:
        InputError: The experiment compares no such plug-ins.
    """
    if experiment.plug_in != kind:
        takers = ", ".join(one for one in FILES if load(one).plug_in == kind)
        raise InputError(
            f"experiment {experiment.id} does not take --{kind}; these do: {takers or 'none'}"
        )
    return replace(experiment, run=partial(experiment.run, own=name))


def measure(
    experiment: Experiment, say: Say, seeds: int | None = None, body: str | None = None
) -> tuple[Experiment, Outcome]:
    """Run an experiment.

    Args:
        experiment: The experiment.
        say: Progress callback.
        seeds: Number of seeds; None: the experiment's default.
        body: One of `BODIES`, or "both"; None: the experiment's default.

    Returns:
        The experiment and its outcome. With both bodies, the figures and targets of the second body end in
        its name, and the table ends with a comparison.

    Raises:
        InputError: A body is given, but no robot walks in this experiment.
    """
    seeds = seeds or experiment.seeds
    if not experiment.body:
        if body:
            walkers = ", ".join(name for name in FILES if load(name).body)
            raise InputError(
                f"experiment {experiment.id}: no robot walks in it, so it takes no --body; "
                f"these experiments do: {walkers}"
            )
        return experiment, experiment.run(seeds, say)
    if body != "both":
        return experiment, experiment.run(seeds, say, body or experiment.body)
    found = {one: experiment.run(seeds, say, one) for one in BODIES}
    first, second = (outcome.figures for outcome in found.values())
    table = [
        line for one, out in found.items() for line in (f"with the {one} body", *out.table, "")
    ]
    width = max(map(len, first))
    table.append(f"{'':{width}}  {BODIES[0]:>10}  {BODIES[1]:>10}")
    table += [f"{name:{width}}  {first[name]:10.4g}  {second[name]:10.4g}" for name in first]
    more = {f"{name}_{BODIES[1]}": value for name, value in second.items()}
    targets = {f"{name}_{BODIES[1]}": target for name, target in experiment.targets.items()}
    widened = replace(experiment, targets={**experiment.targets, **targets})
    drawings = [
        replace(drawing, name=f"{drawing.name}-{one}", sentence=f"{drawing.sentence} ({one} body)")
        for one, out in found.items()
        for drawing in out.drawings
    ]
    return widened, Outcome({**first, **more}, table, found[BODIES[0]].columns, drawings)


def judge(experiment: Experiment, outcome: Outcome) -> dict[str, Any]:
    """Figures, targets and verdict as `--json` prints them; a target without a figure is not met."""
    figures = {name: float(value) for name, value in outcome.figures.items()}
    return {
        "id": experiment.id,
        "title": experiment.title,
        "figures": figures,
        "targets": {name: [t.relation, t.bound] for name, t in experiment.targets.items()},
        "published": dict(experiment.published),
        "columns": [list(row) for row in outcome.columns],
        "table": list(outcome.table),
        "passed": all(
            target.met_by(figures.get(name, float("nan")))
            for name, target in experiment.targets.items()
        ),
    }


def lines(result: Mapping[str, Any]) -> list[str]:
    """Readable lines: the tables, then each figure with its target and the published number."""
    shown = [f"{result['id']}  {result['title']}", *result["table"], ""]
    figures = {name: math.nan if v is None else v for name, v in result["figures"].items()}
    columns = [(words, paper, its, ours) for words, paper, its, ours in result["columns"]]
    if columns:
        shown += [*three_columns(figures, columns), ""]
    width = max((len(name) for name in figures), default=0)
    for name, value in figures.items():
        note = ""
        if name in result["targets"]:
            relation, bound = result["targets"][name]
            met = Target(relation, bound).met_by(value)
            note = f"   {'met ' if met else 'MISSED'} {relation} {bound:g}"
        if name in result["published"]:
            note += f"   (published {result['published'][name]:g})"
        shown.append(f"  {name:<{width}}  {value:10.4g}{note}")
    missing = [name for name in result["targets"] if name not in figures]
    shown += [f"  {name:<{width}}  not measured   MISSED" for name in missing]
    shown.append("passed" if result["passed"] else "NOT PASSED")
    return shown
