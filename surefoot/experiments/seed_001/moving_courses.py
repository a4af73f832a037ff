"""Courses of 30 m through via points among sixteen obstacles, four of them moving; every contact counts.

Most walks use geometric perception (`support/geometric_perception.py`): slow and fast moving obstacles with the errors
and misses of images, and fast ones with error-free perception. The slow course is also walked from images. The
baselines replace the guard on the fast courses. On a quarter of the slow courses ours
and seed 001's own walker (`univector.mode` "seed", with its gaze; "printed" for the printed weights) walk at the printed
speed.

Source: Yoo and Kim 2010 (seed 001), section V-C.
"""

from __future__ import annotations

from planning.univector.fields import FieldConfig

from ...evaluation.metrics.contact_classes import Contact
from ..support.experiment import Experiment, Outcome, Say, Target
from .course_images import image_figures
from .course_trials import BASELINES, PAPER_S, PRINTED_MPS, Trial, figures, walk_groups

PRINTED_SPEED: dict[str, FieldConfig | None] = {
    "slow, ours, 0.0615 m/s": None,
    "slow, seed 001, 0.0615 m/s": FieldConfig(mode="seed"),
    "  with the printed weights": FieldConfig(mode="printed"),
}
SHOWN = (
    *("contact_free_share", "contacts", "avoidable_contacts", "arrived_share", "on_time_share"),
    *("time_s_mean", "min_clearance_mm", "turning_deg_mean"),
)
ROWS = (
    ("contacts of one walk", 0.0, "contacts_per_walk_seed_0615", "contacts_per_walk_ours_0615"),
    ("  with the printed weights", 0.0, "contacts_per_walk_printed_0615", ""),
    ("walks without contact, share", 1.0, "contact_free_share_seed_0615", "contact_free_share_ours_0615"),
    ("all via points reached, share", 1.0, "arrived_share_seed_0615", "arrived_share_ours_0615"),
    ("time, s", PAPER_S, "time_s_mean_seed_0615", "time_s_mean_ours_0615"),
    ("turning, deg", None, "turning_deg_mean_seed_0615", "turning_deg_mean_ours_0615"),
)  # fmt: skip
ENDINGS = ("_ours_0615", "_seed_0615", "_printed_0615")
IMAGE_SEEDS = 10
"""Slow courses walked from images too, by ours and by seed 001; a walk takes four minutes of one core."""


def run(
    seeds: int,
    say: Say,
    body: str = "kinematic",
    image_seeds: int = IMAGE_SEEDS,
    peers: bool = True,
) -> Outcome:
    """Seeds 0 to n - 1 of slow and fast courses; baselines on a quarter of them.

    Args:
        seeds: Number of courses of each kind.
        say: Takes lines of progress.
        body: Body that walks.
        image_seeds: Number of slow courses walked from images, at most `seeds`.
        peers: Also the baselines, and walks at the printed speed, which take longest.
    """
    quarter = max(seeds // 4, 1)
    groups = {
        "slow, sensors": [Trial("course", seed) for seed in range(seeds)],
        "fast, sensors": [Trial("fast_course", seed) for seed in range(seeds)],
        "fast, error-free perception": [
            Trial("fast_course", seed, perfect=True) for seed in range(seeds)
        ],
    }
    for name in BASELINES if peers else ():
        groups[f"fast, {name}"] = [
            Trial("fast_course", seed, stepper=name) for seed in range(quarter)
        ]
    slow = tuple(PRINTED_SPEED.items()) if peers else ()
    for name, field in slow:
        groups[name] = [
            Trial("course", seed, field=field, cruise_mps=PRINTED_MPS) for seed in range(quarter)
        ]
    found, table = walk_groups(groups, say, body)
    result = figures(found["slow, sensors"])
    for (name, _), ending in zip(slow, ENDINGS[: len(slow)], strict=True):
        result |= {
            figure: value
            for figure, value in figures(found[name], ending).items()
            if figure.removesuffix(ending) in SHOWN
        }
        result[f"contacts_per_walk{ending}"] = result[f"contacts{ending}"] / quarter
    result |= figures(found["fast, sensors"], "_fast")
    truth = figures(found["fast, error-free perception"], "_truth")
    result |= {
        name: truth[name]
        for name in ("contact_free_share_truth", "falls_truth", "time_s_mean_truth")
    }
    if peers:
        result |= _against(
            figures(found["fast, sensors"][:quarter]),
            {name: figures(found[f"fast, {name}"]) for name in BASELINES},
        )
    for name, trials in groups.items():
        for trial, one in zip(trials, found[name], strict=True):
            table += [f"  {name}, seed {trial.seed}: {_line(contact)}" for contact in one.contacts]
    images = min(seeds, image_seeds)
    if images:
        seen, lines = image_figures(images, found["slow, sensors"][:images], say, body)
        result |= seen
        table += lines
    return Outcome(result, table, ROWS)


def _against(ours: dict[str, float], baselines: dict[str, dict[str, float]]) -> dict[str, float]:
    """Contacts beyond those of the best baseline, and time by that of each."""
    fewest = min(baseline["contacts"] for baseline in baselines.values())
    times = {
        f"time_over_{name.replace(' ', '_')}": ours["time_s_mean"] / baseline["time_s_mean"]
        for name, baseline in baselines.items()
    }
    return {"contacts_over_best_peer": ours["contacts"] - fewest, **times}


def _line(contact: Contact) -> str:
    return (
        f"{contact.stamp_s:6.1f} s {contact.object_name}: {contact.kind}, unseen for {contact.unseen_s:.1f} s, "
        f"tracked for {contact.followed_s:.0f} s, reversed {contact.turned_s:.1f} s ago"
        + (", robot standing" if contact.standing else "")
    )


EXPERIMENT = Experiment(
    id="001-E3",
    title="Sixteen obstacles, four of them moving, on 30 m through via points (Yoo and Kim 2010)",
    run=run,
    body="kinematic",
    targets={
        "contact_free_share": Target(">=", 0.97),
        "avoidable_contacts": Target("==", 0.0),
        "contact_free_share_fast": Target(">=", 0.80),
        "avoidable_contacts_fast": Target("<=", 2.0),
        "contact_free_share_truth": Target(">=", 0.99),
        "arrived_share": Target(">=", 0.99),
        "on_time_share": Target(">=", 0.90),
        "contacts_over_best_peer": Target("<=", 0.0),
        "cycle_ms_p99": Target("<=", 5.0),
        "contacts_ours_0615": Target("==", 0.0),
        "arrived_share_ours_0615": Target("==", 1.0),
        "on_time_share_ours_0615": Target("==", 1.0),
        "images_contact_free_share": Target(">=", 0.97),
        "images_arrived_share": Target(">=", 0.99),
        "contacts_seed_0615": Target("==", 0.0),
        "arrived_share_seed_0615": Target("==", 1.0),
        "on_time_share_seed_0615": Target("==", 1.0),
    },
    published={"time_s_mean": PAPER_S},
    seeds=100,
)
