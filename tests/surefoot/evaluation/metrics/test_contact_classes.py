"""Classes of contacts: by the object that was touched, one definition for recorded walks and for courses."""

from __future__ import annotations

import math

import numpy as np
import pytest

from surefoot.evaluation.metrics.contact_classes import Contact, class_counts, contacts_of_run
from surefoot.results.tables import Table

STEP_S, HIT = 0.5, 20.0


def contact(unseen=0.5, followed=20.0, turned=30.0, moves=True, standing=False):
    return Contact(9.0, "mover 1", moves, unseen, followed, turned, standing)


@pytest.mark.parametrize(
    ("one", "kind"),
    [
        (contact(), "avoidable"),
        (contact(unseen=2.5), "unseen"),
        (contact(followed=5.0), "late"),
        (contact(turned=3.0), "reversal"),
        (contact(turned=5.0), "reversal"),
        (contact(unseen=math.inf, followed=0.0), "unseen"),
        (contact(standing=True), "avoidable"),
        (contact(moves=False, unseen=100.0), "avoidable"),
        (contact(moves=False, unseen=math.inf), "avoidable"),
    ],
)
def test_a_contact_has_the_class_of_its_cause(one, kind):
    assert one.kind == kind


def table(names, rows):
    return Table(
        "a table",
        {name: list(column) for name, column in zip(names, zip(*rows, strict=True), strict=True)},
    )


def run(touched, tracked=(), turns_at=-1.0, walks=True):
    """A walk with one contact at 20 s; a cart passes 2 cm beside the robot at that time.

    Args:
        touched: Name of what is touched.
        tracked: Times at which the cart is tracked and seen.
        turns_at: When the cart reverses.
        walks: Whether the robot walks.
    """
    stamps = np.arange(0.0, 30.0, STEP_S)
    pose = np.column_stack([stamps, 0.06 * stamps * walks, 0.0 * stamps, 0.0 * stamps])
    signs = np.where(stamps < turns_at, -1.0, 1.0)
    x = (
        0.06 * HIT * walks
        + 0.1 * np.abs(stamps - max(turns_at, 0.0))
        - 0.1 * (HIT - max(turns_at, 0.0))
    )
    obstacles = table(
        ("stamp_s", "identity", "x_m", "y_m", "vx_mps", "vy_mps", "radius_m", "name"),
        [
            row
            for t, at, sign in zip(stamps, x, signs, strict=True)
            for row in (
                (f"{t}", "1", f"{at}", "0.27", f"{0.1 * sign}", "0", "0.1", "cart"),
                (f"{t}", "101", "5", "5", "0", "0", "0.2", "sofa"),
            )
        ],
    )
    clearance = table(
        ("stamp_s", "clearance_m", "object"),
        [(f"{t}", "-0.01" if t == HIT else "0.3", touched) for t in stamps],
    )
    tracks = [
        {
            "stamp": float(t), "track": 4, "seen": float(t),
            "mean": [float(x[k]), 0.27, float(0.1 * signs[k]), 0.0],
            "covariance": (np.eye(4) * 1e-4).tolist(),
        }
        for k, t in enumerate(stamps) if t in tracked
    ]  # fmt: skip
    return contacts_of_run(clearance, pose, obstacles, tracks)


ALWAYS = tuple(np.arange(0.0, 30.0, STEP_S))


@pytest.mark.parametrize("thing", ["wall", "sofa"])
def test_a_wall_hit_near_a_mover_that_nobody_saw_is_a_wall_hit(thing):
    (found,) = run(thing)
    assert (found.object_name, found.moves, found.kind) == (thing, False, "avoidable")


@pytest.mark.parametrize(
    ("tracked", "turns_at", "kind"),
    [
        (ALWAYS, -1.0, "avoidable"),
        ((), -1.0, "unseen"),
        (ALWAYS[:30], -1.0, "unseen"),  # last seen 5.5 s before
        (ALWAYS[30:], -1.0, "late"),  # followed for 5 s
        (ALWAYS, 15.0, "reversal"),
        (ALWAYS, 10.0, "avoidable"),
    ],
)
def test_a_hit_by_the_mover_has_the_class_of_what_was_known_of_it(tracked, turns_at, kind):
    (found,) = run("cart", tracked, turns_at)
    assert (found.stamp_s, found.moves, found.kind) == (HIT, True, kind)


def test_standing_still_is_counted_but_no_excuse():
    counts = class_counts(run("cart", ALWAYS, walks=False))
    assert (counts["contacts_avoidable"], counts["contacts_standing"]) == (1.0, 1.0)
    assert class_counts(run("cart", ALWAYS))["contacts_standing"] == 0.0
