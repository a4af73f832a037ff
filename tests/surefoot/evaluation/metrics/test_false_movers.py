"""False movers: tracks that count as moving and followed nothing that moves."""

from __future__ import annotations

import pytest

from surefoot.evaluation.metrics.obstacles import obstacle_metrics
from surefoot.results.tables import Table

TRUTH = Table(
    "truth",
    {
        "stamp_s": ["0.0", "0.0", "1.0", "1.0"],
        "identity": ["person", "chair", "person", "chair"],
        "x_m": ["0.0", "3.0", "0.5", "3.0"],
        "y_m": ["0.0", "0.0", "0.0", "0.0"],
        "vx_mps": ["0.5", "0.0", "0.5", "0.0"],
        "vy_mps": ["0.0", "0.0", "0.0", "0.0"],
    },
)


def track(x_m, moving, stamp_s, seen_s=None):
    covariance = [[1e-4 * (i == j) for j in range(4)] for i in range(4)]
    seen = stamp_s if seen_s is None else seen_s
    mean = [x_m, 0.0, 0.0, 0.0]
    return {"stamp": stamp_s, "track": 1, "mean": mean, "covariance": covariance, "moving": moving, "seen": seen}  # fmt: skip


@pytest.mark.parametrize(
    ("entries", "false"),
    [
        ([track(0.0, 0.9, 0.0), track(0.5, 0.9, 1.0)], 0),  # the person
        ([track(0.0, 0.9, 0.0), track(1.5, 0.9, 1.0, seen_s=0.0)], 0),  # who was lost from sight
        ([track(3.0, 0.9, 0.0), track(3.0, 0.8, 1.0)], 1),  # the chair
        ([track(6.0, 0.9, 0.0), track(6.0, 0.8, 1.0)], 1),  # nothing at all
        (
            [track(3.0, 0.9, 0.0), track(3.0, 0.2, 1.0)],
            0,
        ),  # the chair, after a doubt that has passed
    ],
)
def test_a_track_is_a_false_mover_if_it_claims_motion_and_followed_nothing_that_moves(
    entries, false
):
    assert obstacle_metrics(entries, TRUTH)["false_movers"] == false
