"""Shapes: closed outward surfaces and exact distances."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.shapes import Box, Cylinder, convex_gap, distance, outline, patches

inside = st.floats(-1.0, 1.0)
sizes = st.floats(0.05, 1.0)
boxes = st.builds(
    lambda x, y, a, b, yaw: Box((x, y, 0.2), (a, b, 0.4), yaw),
    inside,
    inside,
    sizes,
    sizes,
    st.floats(-3.1, 3.1),
)


@given(boxes)
def test_patches_of_a_box_face_outward_and_have_its_area(box):
    area = 0.0
    for patch in patches(box):
        for triangle in patch.triangles:
            a, b, c = patch.vertices[triangle]
            normal = np.cross(b - a, c - a)
            area += np.linalg.norm(normal) / 2
            assert normal @ ((a + b + c) / 3 - np.array(box.centre)) > 0
            assert normal @ patch.normal > 0
    x, y, z = box.size
    assert area == pytest.approx(2 * (x * z + y * z) + x * y)  # without the lower face on the floor


def test_a_floating_cylinder_is_closed():
    cylinder = Cylinder((0.3, -0.2, 1.0), 0.2, 0.5)
    volume = 0.0
    for patch in patches(cylinder):
        for triangle in patch.triangles:
            volume += np.linalg.det(patch.vertices[triangle]) / 6  # divergence theorem
    sides = 32
    polygon = sides / 2 * math.sin(2 * math.pi / sides) * 0.2**2
    assert volume == pytest.approx(polygon * 0.5)


@given(boxes, st.tuples(st.floats(-2, 2), st.floats(-2, 2)))
def test_distance_to_a_box_agrees_with_its_outline(box, point):
    corners, p = outline(box), np.array(point)
    nearest = min(
        float(np.linalg.norm(a + t * (b - a) - p))
        for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)
        for t in np.linspace(0, 1, 401)
    )
    assert abs(float(distance(box, p[None])[0])) == pytest.approx(nearest, abs=3e-3)


@given(boxes, boxes)
def test_convex_gap_agrees_with_points_on_the_boxes(a, b):
    gap = convex_gap(outline(a), outline(b))
    assert gap == pytest.approx(convex_gap(outline(b), outline(a)), abs=1e-9)
    corners = outline(b)
    share = np.linspace(0, 1, 200)[:, None]
    rim = np.concatenate(
        [p + share * (q - p) for p, q in zip(corners, np.roll(corners, -1, axis=0), strict=True)]
    )
    sampled = float(distance(a, rim).min())
    if gap > 0:
        assert gap == pytest.approx(sampled, abs=6e-3)
    else:
        assert sampled < 6e-3 or float(distance(b, outline(a)).min()) < 6e-3
