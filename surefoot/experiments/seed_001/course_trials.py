"""Trials on the courses of Yoo and Kim 2010 by geometric perception: shared by the experiments on them."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from planning.safety.step_filter import StepFilter, Unfiltered
from planning.univector.fields import FieldConfig

from ...config.presets import on_body
from ...evaluation.metrics.averages import rms
from ...evaluation.metrics.contact_classes import CLASSES
from ..support.course_runner import CourseWalk, course_config, published, walk
from ..support.dynamic_window import DynamicWindow
from ..support.experiment import Say
from ..support.trials import run_all
from ..support.velocity_obstacles import VelocityObstacles

PAPER_S = 560.2  # seed 001, section V-C
PRINTED_MPS = 0.0615  # specification: cruise of seed 001, 0.04 m in 0.65 s

BASELINES = ("dynamic window", "velocity obstacles")

STEPPERS: dict[str, Callable[[], StepFilter | None]] = {
    "guard": lambda: None,
    "field": Unfiltered,
    "dynamic window": DynamicWindow,
    "velocity obstacles": VelocityObstacles,
}
"""Name to the step filter that checks every step; None: the planner's guard."""


@dataclass(frozen=True)
class Trial:
    """One walk.

    Args:
        scene, seed: The course.
        perfect: Error-free perception.
        stepper: One of `STEPPERS`.
        field: Settings of the field; None: the planner's default. With another mode than "ours" the course is walked by
            seed 001 alone.
        body: "kinematic" or "dynamic".
        cruise_mps: Speed to walk at; None: the default.
    """

    scene: str
    seed: int
    perfect: bool = False
    stepper: str = "guard"
    field: FieldConfig | None = None
    body: str = "kinematic"
    cruise_mps: float | None = None


def walk_trial(trial: Trial) -> CourseWalk:
    """Walk one trial."""
    config = on_body(course_config(trial.scene, trial.seed), trial.body)
    if trial.field is not None and trial.field.mode != "ours":
        config = published(config, trial.field.mode)
    elif trial.field is not None:
        config = replace(config, univector=trial.field)
    if trial.cruise_mps is not None:
        config = replace(config, gait=replace(config.gait, cruise_mps=trial.cruise_mps))
    return walk(config, trial.perfect, STEPPERS[trial.stepper]())


def walk_groups(
    groups: Mapping[str, Sequence[Trial]], say: Say, body: str
) -> tuple[dict[str, list[CourseWalk]], list[str]]:
    """Walks of every group of trials with one body, and a table with one row per group."""
    todo = [(replace(trial, body=body),) for trials in groups.values() for trial in trials]
    walks = iter(run_all(walk_trial, todo, say, "courses"))
    found = {name: list(itertools.islice(walks, len(trials))) for name, trials in groups.items()}
    return found, [HEADER, *(row(name, group) for name, group in found.items())]


def figures(walks: Sequence[CourseWalk], suffix: str = "") -> dict[str, float]:
    """Shares and sums over walks; every contact counts in `contacts` and in one class.

    Args:
        walks: Walks of one group.
        suffix: Appended to every name.
    """
    kinds = [contact.kind for one in walks for contact in one.contacts]
    off = np.array([error for one in walks for error in one.pose_errors])
    found = {
        "contact_free_share": float(np.mean([not one.contacts for one in walks])),
        "contacts": float(len(kinds)),
        "falls": float(sum(one.fell for one in walks)),
        "arrived_share": float(np.mean([one.arrived for one in walks])),
        "on_time_share": float(np.mean([one.arrived and one.time_s <= PAPER_S for one in walks])),
        "time_s_mean": float(np.mean([one.time_s for one in walks])),
        "min_clearance_mm": 1e3 * min(one.clearance_m for one in walks),
        "turning_deg_mean": float(np.degrees(np.mean([one.turning_rad for one in walks]))),
        "position_rmse_mm": 1e3 * rms(np.linalg.norm(off[:, :2], axis=1)),
        "heading_rmse_deg": float(np.degrees(np.sqrt(np.mean(off[:, 2] ** 2)))),
        "cycle_ms_p99": float(np.percentile([t for w in walks for t in w.cycle_ms], 99)),
        "decision_ms_p99": float(np.percentile([t for w in walks for t in w.decision_ms], 99)),
    }
    for kind in CLASSES:
        found[f"{kind}_contacts"] = float(kinds.count(kind))
    found["standing_contacts"] = float(
        sum(contact.standing for one in walks for contact in one.contacts)
    )
    return {name + suffix: value for name, value in found.items()}


HEADER = f"{'':34}  n  free %  contacts  avoidable  falls  arrived %  on time %  time s  clear mm  turning deg"


def row(name: str, walks: Sequence[CourseWalk]) -> str:
    """One row of a table under `HEADER`."""
    f = figures(walks)
    return (
        f"{name:34}{len(walks):3d}  {100 * f['contact_free_share']:6.1f}  {f['contacts']:8.0f}"
        f"  {f['avoidable_contacts']:9.0f}  {f['falls']:5.0f}  {100 * f['arrived_share']:9.1f}"
        f"  {100 * f['on_time_share']:9.1f}  {f['time_s_mean']:6.1f}"
        f"  {f['min_clearance_mm']:8.0f}  {f['turning_deg_mean']:11.0f}"
    )
