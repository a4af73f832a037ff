"""The search for faces."""

from __future__ import annotations

import math

import numpy as np
import pytest

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
        return run, candidate[0], candidate[1] + 1.0

    monkeypatch.setattr(faces, "_refined", moved_away)
    monkeypatch.setattr(faces, "_same", lambda *face: True)  # one that is there already
    assert len(faces.find(wall(2.0), 0.08)) == 1


def seen_box(length_m, width_m, tops, turn, middle, noise_m=0.004) -> tuple[Columns, np.ndarray]:
    """Columns of two sides and the top of a box, seen from ahead and left of it; the length is cut in as many parts as tops.

    Returns also the rotation from the axes of the box.
    """
    rng = np.random.default_rng(3)
    step, wall_m = 0.02, 0.01
    x, y = np.arange(0.5 * step, length_m, step), np.arange(0.5 * step, width_m, step)
    x, y = (axis.ravel() for axis in np.meshgrid(x, y))
    upright = (y > width_m - step) | (x > length_m - step)
    y = np.where(y > width_m - step, width_m - wall_m, y)
    n, c, s = len(x), math.cos(turn), math.sin(turn)
    turned = np.array([[c, -s], [s, c]])
    place = np.column_stack([x, y]) + np.where(upright, noise_m, 0.0)[
        :, None
    ] * rng.standard_normal((n, 2))
    top = np.array(tops)[(len(tops) * x / length_m).astype(int)]
    top -= 0.3 * ((x < length_m - 0.25) & (y < width_m - 0.25))  # a rim: behind it the top is lower
    columns = Columns(
        stay=np.ones(n),
        sensor=np.tile(turned @ [length_m + 1.5, width_m + 1.5] + middle, (n, 1)),
        pose_variance=np.full(n, 1e-4),
        noise_variance=np.full(n, 1e-4),
        colour=np.tile([10.0, 20.0, 30.0], (n, 1)),
        occupancy=np.ones(n),
        xy=place @ turned.T + middle,
        weight=np.full(n, 9.0),
        count=np.where(upright, (top / 0.02).astype(int), 1),
        low=np.where(upright, 0.0, top),
        top=top,
        upright=upright,
    )
    return columns, turned


@pytest.mark.parametrize("turn", np.arange(0.1, 6.2, 1.3))
def test_the_visible_sides_of_a_box_are_two_faces_wherever_it_stands(turn):
    middle = np.array([2.0 * turn - 5.0, 3.0 - turn])
    columns, turned = seen_box(0.9, 0.5, (0.7,), turn, middle)
    long, short = faces.find(columns, 0.08)
    left, front = turned[:, 1], turned[:, 0]
    sides = ((long, left, (0.45, 0.49), 0.9), (short, front, (0.89, 0.25), 0.5))
    for face, normal, within, length_m in sides:
        assert math.acos(min(face.normal @ normal, 1.0)) < math.radians(1.0)
        assert face.normal @ (turned @ within + middle) == pytest.approx(face.offset_m, abs=0.01)
        assert face.length_m == pytest.approx(length_m, abs=0.06)
        np.testing.assert_allclose(face.ends @ face.normal, face.offset_m, atol=1e-9)
        assert face.top_m == pytest.approx(0.7)
        np.testing.assert_allclose(face.colour, [10.0, 20.0, 30.0])
        off = np.abs(columns.xy[face.columns] @ face.normal - face.offset_m)
        assert off.max() < 0.05
        assert columns.upright[face.columns].all()
    assert faces.group([long, short]) == [[0, 1]]  # their corner is convex


def test_without_a_sensor_the_border_is_seen_from_outside():
    """As in an obstacle cloud of which only the places are known."""
    columns, turned = seen_box(0.8, 0.6, (0.7,), 0.7, np.array([2.0, -1.0]))
    known = {name: getattr(columns, name) for name in Columns.__dataclass_fields__}
    everywhere = np.ones(len(columns), dtype=bool)
    found = faces.find(
        Columns(**known | {"sensor": np.full((len(columns), 2), np.nan), "upright": everywhere}),
        0.08,
    )
    sides = [turned[:, 1], -turned[:, 1], turned[:, 0], -turned[:, 0]]
    assert len(found) == 4
    for normal, length_m, half_m in zip(
        sides, (0.8, 0.8, 0.6, 0.6), (0.3, 0.3, 0.4, 0.4), strict=True
    ):
        (face,) = [one for one in found if one.normal @ normal > 0.99]
        assert face.length_m == pytest.approx(length_m, abs=0.07)
        assert face.normal @ (turned @ [0.4, 0.3] + [2.0, -1.0]) == pytest.approx(
            face.offset_m - half_m, abs=0.03
        )
    assert faces.group(found) == [[0, 1, 2, 3]]


def test_a_face_is_cut_where_the_top_behind_it_changes():
    columns, turned = seen_box(1.2, 0.4, (0.5, 0.9), 0.4, np.zeros(2))
    long = [face for face in faces.find(columns, 0.08) if face.normal @ turned[:, 1] > 0.9]
    ends = sorted((tuple(sorted(face.ends @ turned[:, 0])), face.top_m) for face in long)
    assert [top for _, top in ends] == [0.5, 0.9]
    np.testing.assert_allclose([end for end, _ in ends], [(0.0, 0.6), (0.6, 1.2)], atol=0.07)
    assert faces.differ(*long) == (True, False)  # other height, same colour


def test_two_walls_of_a_room_are_two_things_and_a_gap_ends_a_face():
    """The corner of a room is concave; a door of 0.5 m is a gap."""
    x = np.arange(0.01, 3.0, 0.02)
    along = x[(x < 1.2) | (x > 1.7)]
    xy = np.concatenate([np.column_stack([along, 0 * along]), np.column_stack([0 * x, x])])
    one = wall(2.0)
    n = len(xy)
    columns = one.of(np.zeros(n, np.int64))
    columns = Columns(
        **{
            **{name: getattr(columns, name) for name in Columns.__dataclass_fields__},
            "xy": xy,
            "sensor": np.tile([1.5, 1.5], (n, 1)),
        }
    )
    found = sorted(faces.find(columns, 0.08), key=lambda face: -face.length_m)
    assert [round(face.length_m, 1) for face in found] == [3.0, 1.3, 1.2]
    np.testing.assert_allclose([face.normal for face in found], [[1, 0], [0, 1], [0, 1]], atol=0.05)
    assert [sorted(group) for group in faces.group(found)] == [[0], [1], [2]]
