"""The search for faces."""

from __future__ import annotations

import numpy as np

from mapping.objects import faces
from mapping.objects.columns import Columns


def wall(length_m: float) -> Columns:
    """Upright columns along the y axis, seen from +x."""
    y = np.arange(0.0, length_m, 0.02)
    n = len(y)
    return Columns(
        stay=np.ones(n),
        sensor=np.tile([2.0, length_m / 2], (n, 1)),
        pose_variance=np.full(n, 1e-4),
        noise_variance=np.full(n, 1e-4),
        colour=np.full((n, 3), np.nan),
        occupancy=np.ones(n),
        xy=np.column_stack([np.zeros(n), y]),
        weight=np.full(n, 9.0),
        count=np.full(n, 20),
        low=np.zeros(n),
        top=np.full(n, 0.8),
        upright=np.ones(n, dtype=bool),
    )


def test_a_wall_is_one_face_towards_the_sensor():
    (face,) = faces.find(wall(2.0), 0.08)
    np.testing.assert_allclose(face.normal, [1.0, 0.0], atol=1e-6)
    assert abs(face.length_m - 1.98) < 1e-6


def test_the_search_ends_where_a_fit_leaves_its_columns(monkeypatch):
    calls = 0

    def moved_away(columns, towards, usable, candidate, gap_m):
        nonlocal calls
        calls += 1
        assert calls <= len(columns), "the same columns are tried again and again"
        run = np.flatnonzero(usable[1])[:6]
        return run, candidate[0], candidate[1] + 1.0, True

    monkeypatch.setattr(faces, "_refined", moved_away)
    monkeypatch.setattr(faces, "_same", lambda *face: True)  # one that is there already
    assert len(faces.find(wall(2.0), 0.08)) == 1
