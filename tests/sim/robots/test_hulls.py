"""Hulls of links: closed forms, what they may cut off, and meshes in Collada."""

import xml.etree.ElementTree as ET

import numpy as np
import pytest

from perception.primitives.errors import InputError
from sim.robots.hulls import collada_points, hull_of, points_of

CUBE = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 2.0) for z in (0.0, 3.0)])


def volume(hull):
    """By the divergence theorem; positive if the triangles run counter-clockwise from outside."""
    a, b, c = (hull.corners[hull.triangles[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum()) / 6.0


def test_the_hull_of_a_box_is_the_box():
    hull = hull_of("box", 3, np.concatenate([CUBE, CUBE / 2 + 0.1]))
    assert hull is not None
    assert volume(hull) == pytest.approx(6.0)
    assert (len(hull.corners), hull.link, hull.cut_m) == (8, 3, pytest.approx(0.0, abs=1e-12))


def test_a_round_hull_is_cut_by_no_more_than_it_says():
    points = np.random.default_rng(0).standard_normal((4000, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    hull = hull_of("ball", 0, points)
    assert hull is not None
    assert len(hull.corners) <= 80
    assert 0.7 * 4.19 < volume(hull) < 4.19
    a, b, c = (hull.corners[hull.triangles[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    out = (points @ normals.T - np.einsum("ij,ij->i", normals, a)).max()
    assert out == pytest.approx(hull.cut_m, abs=1e-9)


@pytest.mark.parametrize("shape", ['sphere radius="0.2"', 'cylinder radius="0.2" length="0.3"'])
def test_no_round_shape_reaches_out_of_its_hull_by_more_than_it_says(shape, tmp_path):
    visual = ET.fromstring(f"<visual><geometry><{shape}/></geometry></visual>")
    hull = hull_of("round", 0, points_of(visual, tmp_path / "a.urdf"))
    rng = np.random.default_rng(0)
    if shape.startswith("sphere"):
        surface = rng.standard_normal((9000, 3))
        surface *= 0.2 / np.linalg.norm(surface, axis=1, keepdims=True)
    else:
        angle = rng.uniform(0.0, 2.0 * np.pi, 9000)
        ends = rng.choice([-0.15, 0.15], 9000)
        surface = np.column_stack([0.2 * np.cos(angle), 0.2 * np.sin(angle), ends])
    a, b, c = (hull.corners[hull.triangles[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    out = (surface @ normals.T - np.einsum("ij,ij->i", normals, a)).max()
    assert out <= hull.cut_m + 1e-9
    assert hull.cut_m < 0.015


@pytest.mark.parametrize("points", [CUBE[:3], CUBE * np.array([1.0, 1.0, 0.0])])
def test_what_has_no_volume_has_no_hull(points):
    assert hull_of("sheet", 0, points) is None


@pytest.mark.parametrize(
    ("shape", "extent"),
    [
        ('<box size="1 2 3"/>', [1.0, 2.0, 3.0]),
        ('<sphere radius="0.5"/>', [1.0, 1.0, 1.0]),
        ('<cylinder radius="0.5" length="2"/>', [1.0, 1.0, 2.0]),
    ],
)
def test_a_shape_is_inside_its_points_and_where_its_origin_says(shape, extent, tmp_path):
    visual = ET.fromstring(
        f'<visual><origin xyz="1 2 3" rpy="0 0 0"/><geometry>{shape}</geometry></visual>'
    )
    points = points_of(visual, tmp_path / "a.urdf")
    np.testing.assert_allclose(np.ptp(points, axis=0), extent, rtol=0.01)
    np.testing.assert_allclose((points.max(0) + points.min(0)) / 2, [1.0, 2.0, 3.0], atol=1e-9)


DAE = """<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit meter="0.01"/><up_axis>{up}</up_axis></asset>
<library_geometries><geometry id="g"><mesh>
<source id="p"><float_array>0 0 0 100 0 0 0 200 0 0 0 300</float_array></source>
<source id="n"><float_array>9 9 9</float_array></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices></mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene><node><matrix>1 0 0 100 0 1 0 0 0 0 1 0 0 0 0 1</matrix>
<node><scale>1 1 2</scale><instance_geometry url="#g"/></node></node></visual_scene></library_visual_scenes>
</COLLADA>"""
TURN = "<rotate>{}</rotate>"


def test_collada_vertices_are_placed_in_metres_with_z_up(tmp_path):
    path = tmp_path / "a.dae"
    path.write_text(DAE.format(up="Z_UP"))
    raw = np.array([[1, 0, 0], [2, 0, 0], [1, 2, 0], [1, 0, 6]], float)
    np.testing.assert_allclose(collada_points(path), raw)
    path.write_text(DAE.format(up="Y_UP"))
    np.testing.assert_allclose(collada_points(path), np.c_[raw[:, 0], -raw[:, 2], raw[:, 1]])


def test_a_collada_node_turns_about_an_axis_by_degrees(tmp_path):
    """A quarter about z and then the file's shift of 1 m along x; the axis need not have unit length."""
    path = tmp_path / "a.dae"
    path.write_text(DAE.format(up="Z_UP").replace("<scale>1 1 2</scale>", TURN.format("0 0 2 90")))
    turned = np.array([[1, 0, 0], [1, 1, 0], [-1, 0, 0], [1, 0, 3]], float)
    np.testing.assert_allclose(collada_points(path), turned, atol=1e-12)


@pytest.mark.parametrize(
    "text",
    [
        *("", "<COLLADA/>", DAE.replace("200", "x"), DAE.replace("#g", "#h")),
        *(DAE.replace("<scale>1 1 2</scale>", TURN.format(one)) for one in ("0 0 1", "0 0 0 90")),
    ],
)
def test_a_damaged_collada_file_is_refused_by_name(text, tmp_path):
    path = tmp_path / "a.dae"
    path.write_text(text)
    with pytest.raises(InputError, match=r"a\.dae"):
        collada_points(path)
