"""Ablation of the additions to the univector field and of the guard, among moving obstacles.

Field alone, each addition alone, all additions, the guard with the field alone, and all together, on the same courses
with slow moving obstacles; the path search around static obstacles is always on. Courses contain situations that the
additions are not made for; the benefit of uncertainty is therefore also measured in encounters with a single moving
obstacle that crosses the path (`encounters`), and that of the virtual obstacle in meetings with one that comes along the
path (`head_on`). "seed 001" is its whole motion by its own planner and gaze, "seed 001 as printed" with the printed
weights. The weight of the virtual obstacle was chosen in the meeting of the specification, the angles at which an
obstacle counts as crossing in encounters from seed 1000 on; drawn meetings, encounters and courses here are other ones.

Source: Yoo and Kim 2010 (seed 001), section 4; the variants are ours.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from planning.planners.settings import BESIDE_GUARD
from planning.univector.fields import FieldConfig

from ..support.experiment import Experiment, Outcome, Say, Target, combined
from ..support.trials import run_trials
from . import head_on
from .course_trials import Trial, figures, walk_groups
from .encounters import Encounter, encounters

ALL = replace(
    BESIDE_GUARD,
    gaze_coupling=True,
    virtual_obstacles=True,
    velocity_change=True,
    uncertainty=True,
)
VARIANTS = {
    "field alone": ("field", BESIDE_GUARD),
    "virtual obstacle": ("field", replace(BESIDE_GUARD, virtual_obstacles=True)),
    "velocity change": ("field", replace(BESIDE_GUARD, velocity_change=True)),
    "uncertainty": ("field", replace(BESIDE_GUARD, uncertainty=True)),
    "gaze coupling": ("field", replace(BESIDE_GUARD, gaze_coupling=True)),
    "all additions": ("field", ALL),
    "guard": ("guard", BESIDE_GUARD),
    "all additions and guard": ("guard", ALL),
    "seed 001": ("field", FieldConfig(mode="seed")),
    "seed 001 as printed": ("field", FieldConfig(mode="printed")),
}
"""Name to step filter and field settings."""

ENCOUNTER_FIELDS = {
    "field alone": BESIDE_GUARD,
    "velocity change": replace(BESIDE_GUARD, velocity_change=True),
    "virtual obstacle": replace(BESIDE_GUARD, virtual_obstacles=True),
    "both": replace(BESIDE_GUARD, velocity_change=True, virtual_obstacles=True),
}
"""Field settings of the encounters, each without and with uncertainty."""
COMPARED = (
    *("contact_free_share", "contacts", "falls", "time_s_mean"),
    *("min_clearance_mm", "turning_deg_mean"),
)
"""Figures of every variant."""
ROWS = (
    ("contacts on all courses", None, "contacts_seed_001", "contacts_guard"),
    ("the same with the printed weights", None, "contacts_seed_001_as_printed", ""),
    ("turning per course, deg", None, "turning_deg_mean_seed_001", "turning_deg_mean_guard"),
    ("head-on: the turn begins at, m", None, "specified_onset_m_seed", "specified_onset_m_ours"),
    ("head-on: turning, deg", None, "specified_turning_deg_seed", "specified_turning_deg_ours"),
    ("head-on: least gap, m", None, "specified_gap_m_seed", "specified_gap_m_ours"),
    ("meetings: contacts", None, "meeting_contacts_seed", "meeting_contacts_ours"),
)
ENCOUNTERS = 10  # per course
CHUNK = 50  # encounters per task


def run(seeds: int, say: Say, body: str = "kinematic", courses: bool = True) -> Outcome:
    """Seeds 0 to n - 1, every variant on each of the `courses`, and encounters with one obstacle."""
    walked = _course_figures(seeds, say, body) if courses else ({}, [])
    met = head_on.figures(range(seeds))
    outcome = combined(walked, _encounter_figures(ENCOUNTERS * seeds, say), met)
    return replace(outcome, columns=ROWS)


def _course_figures(seeds: int, say: Say, body: str) -> tuple[dict[str, float], list[str]]:
    """Figures of every variant on every course."""
    groups = {
        name: [Trial("course", seed, stepper=stepper, field=field) for seed in range(seeds)]
        for name, (stepper, field) in VARIANTS.items()
    }
    found, table = walk_groups(groups, say, body)
    result: dict[str, float] = {}
    for name, walks in found.items():
        values = figures(walks)
        result |= {f"{figure}_{name.replace(' ', '_')}": values[figure] for figure in COMPARED}
    result["contacts_saved_by_guard"] = result["contacts_field_alone"] - result["contacts_guard"]
    result["falls"] = float(sum(one.fell for walks in found.values() for one in walks))
    return result, table


def _encounter_figures(number: int, say: Say) -> tuple[dict[str, float], list[str]]:
    """Figures of encounters with one moving obstacle, the same for every field, without and with uncertainty."""
    lines = [
        f"{number} single encounters              contacts  clear mm (5 %)  time s  turning deg"
    ]
    found: dict[str, float] = {}
    chunks = [range(k, min(k + CHUNK, number)) for k in range(0, number, CHUNK)]
    fields = {
        (name, certainty): replace(field, uncertainty=certainty == "uncertain")
        for name, field in ENCOUNTER_FIELDS.items()
        for certainty in ("certain", "uncertain")
    }
    tasks = [(chunk, field) for field in fields.values() for chunk in chunks]
    done = list(run_trials(encounters, tasks))
    for k, (name, certainty) in enumerate(fields):
        say(f"encounters: {name}, {certainty}")
        part = [one for some in done[k * len(chunks) : (k + 1) * len(chunks)] for one in some]
        contacts, lowest, time_s, turning = _summary(part)
        found[f"crossing_contacts_{name.replace(' ', '_')}_{certainty}"] = contacts
        lines.append(
            f"  {name + ', ' + certainty:32}{contacts:6.0f}  {lowest:14.0f}  {time_s:6.1f}  {turning:11.0f}"
        )
    for name in ENCOUNTER_FIELDS:
        key = name.replace(" ", "_")
        found[f"crossing_contacts_saved_by_uncertainty_{key}"] = (
            found[f"crossing_contacts_{key}_certain"] - found[f"crossing_contacts_{key}_uncertain"]
        )
    return found, lines


def _summary(crossings: Sequence[Encounter]) -> tuple[float, float, float, float]:
    """Contacts, 5 % quantile of the clearance, mm, mean time, s, mean turning, deg."""
    gaps = np.array([one.clearance_m for one in crossings])
    return (
        float(np.sum(gaps < 0.0)),
        1e3 * float(np.percentile(gaps, 5)),
        float(np.mean([one.time_s for one in crossings])),
        float(np.degrees(np.mean([one.turning_rad for one in crossings]))),
    )


EXPERIMENT = Experiment(
    id="001-E4",
    title="Ablation: virtual obstacle, velocity change, uncertainty, gaze coupling, guard (Yoo and Kim 2010)",
    run=run,
    body="kinematic",
    targets={
        "meeting_earlier_m": Target(">", 0.0),
        "meeting_turning_saved_deg": Target(">", 0.0),
        "meeting_gap_gained_m": Target(">", 0.0),
        "specified_onset_m_virtual": Target(">=", 1.43),
        "specified_turning_deg_virtual": Target("<=", 143.0),
        "specified_gap_m_virtual": Target(">=", 0.235),
        "contacts_saved_by_guard": Target(">", 0.0),
        "crossing_contacts_saved_by_uncertainty_field_alone": Target(">", 0.0),
        "crossing_contacts_saved_by_uncertainty_velocity_change": Target(">", 0.0),
        "crossing_contacts_saved_by_uncertainty_virtual_obstacle": Target(">", 0.0),
        "crossing_contacts_saved_by_uncertainty_both": Target(">", 0.0),
    },
    seeds=100,
)
