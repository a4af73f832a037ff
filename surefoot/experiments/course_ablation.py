"""001-E4: what each addition to the univector field does among moving obstacles, and what the guard does.

Field alone, each addition alone, all additions, the guard beside the field alone, and everything, over the same
courses with slow movers; the joint search leads round what stands in all of them.
"""

from __future__ import annotations

from dataclasses import replace

from ..config import BESIDE_GUARD
from .course_trials import HEADER, Trial, figures, row, try_all
from .experiment import Experiment, Outcome, Say, Target

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
                "time_s_mean",
                "min_clearance_mm",
                "turning_deg_mean",
            )
        }
    result["contacts_saved_by_guard"] = result["contacts_field_alone"] - result["contacts_guard"]
    return Outcome(result, table)


EXPERIMENT = Experiment(
    id="001-E4",
    title="With and without virtual obstacle, velocity change, uncertainty, gaze coupling, guard",
    run=run,
    body="kinematic",
    targets={"contacts_saved_by_guard": Target(">", 0.0)},
    seeds=100,
)
