"""Many courses by geometry: what the experiments on seed 001's courses have in common."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from planning.safety.dynamic_window import DynamicWindow
from planning.safety.step_filter import StepFilter, Unfiltered
from planning.safety.velocity_obstacles import VelocityObstacles
from planning.univector.fields import FieldConfig

from ...config.presets import on_body
from ...evaluation.metrics.contacts import CLASSES
from ..support.course_runner import Walk, course_config, walk
from ..support.experiment import Say
from ..support.trials import each

PAPER_S = 560.2  # seed 001, section V-C

STEPPERS: dict[str, Callable[[], StepFilter | None]] = {
    "guard": lambda: None,
    "field": Unfiltered,
    "dynamic window": DynamicWindow,
    "velocity obstacles": VelocityObstacles,
}
"""Who has the last word on a step; None: the guard of the navigator."""


@dataclass(frozen=True)
class Trial:
    """One walk to make.

    Args:
        scene, seed: Which course.
        perfect: Perception without errors.
        stepper: One of `STEPPERS`.
        field: Switches of the field; None: as beside the guard.
        body: Who walks.
    """

    scene: str
    seed: int
    perfect: bool = False
    stepper: str = "guard"
    field: FieldConfig | None = None
    body: str = "kinematic"


def try_out(trial: Trial) -> Walk:
    """Walk it."""
    config = on_body(course_config(trial.scene, trial.seed), trial.body)
    if trial.field is not None:
        config = replace(config, univector=trial.field)
    return walk(config, trial.perfect, STEPPERS[trial.stepper]())


def try_all(trials: Iterable[Trial], say: Say, body: str) -> list[Walk]:
    """All walks, by one body, in order, each in a process of its own."""
    trials = [replace(trial, body=body) for trial in trials]
    found: list[Walk] = []
    for one in each(try_out, [(trial,) for trial in trials]):
        found.append(one)
        say(f"{len(found)} of {len(trials)} courses")
    return found


def figures(walks: Sequence[Walk], suffix: str = "") -> dict[str, float]:
    """Shares and sums over walks; every contact is counted in `contacts` and in one class.

    Args:
        walks: Of one kind.
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
        "position_rmse_mm": 1e3 * float(np.sqrt(np.mean(off[:, :2] ** 2))),
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


def row(name: str, walks: Sequence[Walk]) -> str:
    """One line of a table under `HEADER`."""
    f = figures(walks)
    return (
        f"{name:34}{len(walks):3d}  {100 * f['contact_free_share']:6.1f}  {f['contacts']:8.0f}"
        f"  {f['avoidable_contacts']:9.0f}  {f['falls']:5.0f}  {100 * f['arrived_share']:9.1f}"
        f"  {100 * f['on_time_share']:9.1f}  {f['time_s_mean']:6.1f}"
        f"  {f['min_clearance_mm']:8.0f}  {f['turning_deg_mean']:11.0f}"
    )
