"""001-E4: what each addition to the univector field does among moving obstacles, and what the guard does.

Field alone, each addition alone, all additions, the guard beside the field alone, and everything, over the same
courses with slow movers; the joint search leads round what stands in all of them. In a course the additions are
mixed with all that they are not made for; what uncertainty is worth to the change of speed and to the virtual
obstacle is therefore shown by encounters with one mover, too (`crossings`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from planning.planners.settings import BESIDE_GUARD

from ..support.experiment import Experiment, Outcome, Say, Target
from ..support.trials import each
from .course_trials import HEADER, Trial, figures, row, try_all
from .crossings import Crossing, cross_all

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
}
"""Name to stepper and field."""

ALONE = {
    "field alone": BESIDE_GUARD,
    "velocity change": replace(BESIDE_GUARD, velocity_change=True),
    "virtual obstacle": replace(BESIDE_GUARD, virtual_obstacles=True),
    "both": replace(BESIDE_GUARD, velocity_change=True, virtual_obstacles=True),
}
"""What meets one mover, each without and with uncertainty."""
CROSSINGS = 10  # encounters to every course
CHUNK = 50  # of them in one task


def run(seeds: int, say: Say, body: str = "kinematic") -> Outcome:
    """Seeds 0 to n - 1, every variant on each."""
    trials = [
        Trial("course", seed, stepper=stepper, field=field)
        for stepper, field in VARIANTS.values()
        for seed in range(seeds)
    ]
    walks = try_all(trials, say, body)
    table = [HEADER]
    result: dict[str, float] = {}
    for k, name in enumerate(VARIANTS):
        part = walks[k * seeds : (k + 1) * seeds]
        table.append(row(name, part))
        result |= {
            f"{figure}_{name.replace(' ', '_')}": value
            for figure, value in figures(part).items()
            if figure
            in (
                "contact_free_share",
                "contacts",
                "falls",
                "time_s_mean",
                "min_clearance_mm",
                "turning_deg_mean",
            )
        }
    result["contacts_saved_by_guard"] = result["contacts_field_alone"] - result["contacts_guard"]
    result["falls"] = float(sum(one.fell for one in walks))
    met, lines = _crossings(CROSSINGS * seeds, say)
    return Outcome(result | met, [*table, *lines])


def _crossings(number: int, say: Say) -> tuple[dict[str, float], list[str]]:
    """Encounters with one mover, the same for every field, without and with uncertainty."""
    lines = [f"{number} encounters with one mover   contacts  clear mm (5 %)  time s  turning deg"]
    found: dict[str, float] = {}
    chunks = [range(k, min(k + CHUNK, number)) for k in range(0, number, CHUNK)]
    fields = {
        (name, doubt): replace(field, uncertainty=doubt == "uncertain")
        for name, field in ALONE.items()
        for doubt in ("certain", "uncertain")
    }
    tasks = [(chunk, field) for field in fields.values() for chunk in chunks]
    done = list(each(cross_all, tasks))
    for k, (name, doubt) in enumerate(fields):
        say(f"encounters: {name}, {doubt}")
        part = [one for some in done[k * len(chunks) : (k + 1) * len(chunks)] for one in some]
        contacts, lowest, time_s, turning = _summary(part)
        found[f"crossing_contacts_{name.replace(' ', '_')}_{doubt}"] = contacts
        lines.append(
            f"  {name + ', ' + doubt:32}{contacts:6.0f}  {lowest:14.0f}  {time_s:6.1f}  {turning:11.0f}"
        )
    for name in ALONE:
        key = name.replace(" ", "_")
        found[f"crossing_contacts_saved_by_uncertainty_{key}"] = (
            found[f"crossing_contacts_{key}_certain"] - found[f"crossing_contacts_{key}_uncertain"]
        )
    return found, lines


def _summary(crossings: Sequence[Crossing]) -> tuple[float, float, float, float]:
    """Contacts, clearance that 5 % stay below, mm, mean time, s, mean turning, deg."""
    gaps = np.array([one.clearance_m for one in crossings])
    return (
        float(np.sum(gaps < 0.0)),
        1e3 * float(np.percentile(gaps, 5)),
        float(np.mean([one.time_s for one in crossings])),
        float(np.degrees(np.mean([one.turning_rad for one in crossings]))),
    )


EXPERIMENT = Experiment(
    id="001-E4",
    title="With and without virtual obstacle, velocity change, uncertainty, gaze coupling, guard",
    run=run,
    body="kinematic",
    targets={
        "contacts_saved_by_guard": Target(">", 0.0),
        "crossing_contacts_saved_by_uncertainty_field_alone": Target(">", 0.0),
        "crossing_contacts_saved_by_uncertainty_velocity_change": Target(">", 0.0),
        "crossing_contacts_saved_by_uncertainty_virtual_obstacle": Target(">", 0.0),
        "crossing_contacts_saved_by_uncertainty_both": Target(">", 0.0),
    },
    seeds=100,
)
