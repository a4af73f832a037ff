"""Outlines of objects of which one side was seen."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mapping.objects import outlines
from mapping.objects.columns import CELL_M, Columns
from mapping.objects.faces import Face

TILT = math.radians(1.0)


def board(turn):
    """A bent board, seen from -x and then turned: its columns and two faces, and the turn as a matrix."""
    c, s = math.cos(turn), math.sin(turn)
    rotation = np.array([[c, -s], [s, c]])
    faces, places = [], []
    for side in (-1, 1):
        along = np.linspace(0.0, 0.4, 41)
        xy = np.column_stack([1.0 + along * math.tan(TILT), side * along]) @ rotation.T
        normal = rotation @ np.array([-math.cos(TILT), side * math.sin(TILT)])
        ends = np.sort(xy[[0, -1]] @ np.array([-normal[1], normal[0]]))
        index = np.arange(41) + 41 * len(faces)
        span = (float(ends[0]), float(ends[1]))
        faces.append(
            Face(normal, float(np.mean(xy @ normal)), span, index, 0.5, np.full(3, np.nan))
        )
        places.append(xy)
    xy, ones = np.concatenate(places), np.ones(82)
    seen = (ones, xy - rotation[:, 0], 0 * ones, 0 * ones, np.full((82, 3), np.nan), ones)
    return (
        Columns(*seen, xy, ones, ones.astype(int), 0 * ones, 0.5 * ones, ones > 0),
        faces,
        rotation,
    )


@pytest.mark.parametrize("turn", [0.0, 0.5 * math.pi, math.pi, -0.5 * math.pi, 0.3])
def test_a_board_seen_from_one_side_lies_behind_that_side(turn):
    columns, faces, rotation = board(turn)
    ring = outlines.rectangle(columns, faces)
    assert ring is not None
    x, y = (ring @ rotation).T
    assert (y.min(), y.max()) == pytest.approx((-0.4, 0.4), abs=0.01)
    assert 1.0 <= x.min() <= 1.0 + 0.4 * math.tan(TILT)  # where its face is
    assert x.max() - x.min() == pytest.approx(CELL_M)
