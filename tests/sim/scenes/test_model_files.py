"""Models from files: upright, visible and solid; errors state the remedy."""

from __future__ import annotations

import builtins
import json
import struct
import tracemalloc

import numpy as np
import pytest

from perception.primitives.errors import InputError, SurefootError
from perception.primitives.pose import Pose2
from sim.body.dynamic.anatomy import DARWIN
from sim.body.dynamic.physics import Stage
from sim.body.dynamic.pybullet_engine import PyBulletPhysics
from sim.scenes import catalogue
from sim.scenes.model_files import SHEET_M, read_model
from sim.shapes import Solid, distance
from sim.world import World

PILLAR_M = (0.2, 2.0, 0.3)  # along x, y and z of the file


def write_box(path, size):
    import open3d as o3d

    mesh = o3d.geometry.TriangleMesh.create_box(*size)
    mesh.translate((-size[0] / 2, 0.0, -size[2] / 2))
    if path.suffix == ".glb":  # the one that Open3D writes cannot be read back
        path.write_bytes(binary_gltf(np.asarray(mesh.vertices), np.asarray(mesh.triangles)))
        return path
    assert o3d.io.write_triangle_mesh(str(path), mesh)
    return path


def binary_gltf(vertices, triangles):
    """A glTF file with one mesh below a node: header, description, data."""
    numbers = vertices.astype("<f4").tobytes(), triangles.astype("<u4").tobytes()
    bounds = {"min": vertices.min(axis=0).tolist(), "max": vertices.max(axis=0).tolist()}
    first, second = len(numbers[0]), len(numbers[1])
    description = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "buffers": [{"byteLength": first + second}],
        "bufferViews": [
            {"buffer": 0, "byteLength": first},
            {"buffer": 0, "byteOffset": first, "byteLength": second},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": len(vertices), "type": "VEC3"}
            | bounds,
            {"bufferView": 1, "componentType": 5125, "count": triangles.size, "type": "SCALAR"},
        ],
    }
    text = json.dumps(description).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<I4s", len(text), b"JSON") + text
    body += struct.pack("<I4s", first + second, b"BIN\0") + b"".join(numbers)
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


def write_obj(path, vertices, faces):
    lines = [f"v {x} {y} {z}" for x, y, z in vertices]
    path.write_text("\n".join(lines + ["f " + " ".join(str(k) for k in face) for face in faces]))
    return path


def volume(solid):
    """Volume by the divergence theorem; correct only for a closed surface facing outward."""
    return float(np.linalg.det(solid.vertices[solid.triangles]).sum()) / 6


def size(solid):
    return np.ptp(solid.vertices, axis=0)


@pytest.mark.parametrize(
    ("name", "up", "stands"),
    [
        ("pillar.glb", "", True),
        ("pillar.gltf", "", True),
        ("pillar.glb", "z", False),
        ("pillar.obj", "", False),
        ("pillar.obj", "y", True),
        ("pillar.ply", "z", False),
    ],
)
def test_a_model_with_y_up_is_rotated_upright(tmp_path, name, up, stands):
    (solid,) = read_model(write_box(tmp_path / name, PILLAR_M), up=up)
    x, y, z = PILLAR_M
    np.testing.assert_allclose(size(solid), (x, z, y) if stands else PILLAR_M, atol=1e-6)
    if stands:
        assert (solid.bottom_m, solid.top_m) == pytest.approx((0.0, 2.0), abs=1e-6)
    assert volume(solid) == pytest.approx(x * y * z, rel=1e-5)  # rotated, not mirrored


def test_rotation_to_z_up_keeps_the_front(tmp_path):
    """glTF 2.0, 3.4: +Y up, +Z forward, so that +X is to the left; ours is z up."""
    path = write_obj(
        tmp_path / "a.obj", [(0, 0, 0), (1, 0, 0), (0, 2, 0), (0, 0, 3)], [(1, 3, 2), (1, 2, 4)]
    )
    (solid,) = read_model(path, up="y")
    corners = {tuple(row) for row in np.round(solid.vertices, 6)}
    assert corners == {(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 2.0), (0.0, -3.0, 0.0)}


def test_the_scene_file_sets_the_up_axis(tmp_path):
    write_box(tmp_path / "pillar.obj", PILLAR_M)
    text = "extent = [0, 0, 5, 4]\nstart = [1, 1, 0]\ngoals = [[4, 1]]\n[[model]]\n"
    text += 'file = "pillar.obj"\nat = [2.5, 2.5]\n'
    (tmp_path / "mine.toml").write_text(text + 'up = "y"\n')
    (model,) = catalogue.load(str(tmp_path / "mine.toml"), 0).obstacles
    assert model.parts[0].top_m == pytest.approx(2.0)
    (tmp_path / "mine.toml").write_text(text + 'up = "x"\n')
    with pytest.raises(
        InputError, match=r"""mine.toml: .*up = 'x'; expected "y" or "z" """.strip()
    ):
        catalogue.load(str(tmp_path / "mine.toml"), 0)


PANEL = [(-0.5, 0.0, 0.0), (0.5, 0.0, 0.0), (0.5, 0.0, 1.2), (-0.5, 0.0, 1.2)]
FLAT = [(-0.5, -0.3, 0.4), (0.5, -0.3, 0.4), (0.5, 0.3, 0.4), (-0.5, 0.3, 0.4)]
ONE_SIDE, BOTH_SIDES = [(1, 2, 3), (1, 3, 4)], [(1, 2, 3), (1, 3, 4), (3, 2, 1), (4, 3, 1)]


@pytest.mark.parametrize("faces", [ONE_SIDE, BOTH_SIDES])
@pytest.mark.parametrize(("corners", "area"), [(PANEL, 1.2), (FLAT, 0.6)])
@pytest.mark.parametrize("scale", [1.0, 0.5])
def test_a_sheet_becomes_a_board_of_one_centimetre(tmp_path, corners, area, faces, scale):
    (solid,) = read_model(write_obj(tmp_path / "a.obj", corners, faces), scale=scale)
    assert volume(solid) == pytest.approx(scale**2 * area * SHEET_M, rel=1e-6)
    extents = np.where(np.ptp(corners, axis=0) == 0.0, SHEET_M, scale * np.ptp(corners, axis=0))
    np.testing.assert_allclose(size(solid), extents, atol=1e-9)


def test_a_sheet_keeps_its_outline_and_its_holes(tmp_path):
    """An upright frame of 1 m around a window of 0.6 m, rotated about the vertical."""
    ring = [(-0.5, 0.0), (0.5, 0.0), (0.5, 1.0), (-0.5, 1.0)]
    ring += [(0.6 * x, 0.2 + 0.6 * z) for x, z in ring]
    corners = [(0.6 * x, 0.8 * x, z) for x, z in ring]
    faces = [(1, 2, 6), (1, 6, 5), (2, 3, 7), (2, 7, 6), (3, 4, 8), (3, 8, 7), (4, 1, 5), (4, 5, 8)]
    (solid,) = read_model(write_obj(tmp_path / "a.obj", corners, faces))
    assert volume(solid) == pytest.approx((1.0 - 0.36) * SHEET_M, rel=1e-6)


def test_a_fine_mesh_is_read_quickly(tmp_path):
    """20 000 vertices: no quadratic memory, which would be gigabytes."""
    import open3d as o3d

    ball = o3d.geometry.TriangleMesh.create_sphere(0.5, 100)
    o3d.io.write_triangle_mesh(str(tmp_path / "ball.ply"), ball)
    tracemalloc.start()
    (solid,) = read_model(tmp_path / "ball.ply")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert len(solid.vertices) > 19_000
    assert peak < 100e6
    assert volume(solid) == pytest.approx(4 / 3 * np.pi * 0.5**3, rel=1e-3)


def test_an_upright_panel_stops_rays_and_blocks_the_path(tmp_path):
    write_obj(tmp_path / "panel.obj", PANEL, ONE_SIDE)
    (tmp_path / "mine.toml").write_text(
        "extent = [0, 0, 5, 4]\nstart = [1, 1, 0]\ngoals = [[4, 1]]\ntags = 0\n"
        '[[model]]\nfile = "panel.obj"\nat = [2.5, 2.0]\n'
    )
    scene = catalogue.load(str(tmp_path / "mine.toml"), 0)
    with World(scene, "tiny") as world:
        for y, direction in ((1.0, 1.0), (3.0, -1.0)):  # from both sides
            ray = np.array([[0.0, direction, 0.0]], np.float32)
            hits = world.rays.cast(np.array([2.5, y, 0.6]), ray)
            assert float(hits.distance_m[0]) == pytest.approx(1.0 - SHEET_M / 2, abs=1e-5)
    (panel,) = scene.obstacles
    assert distance(panel.parts[0], np.array([[2.5, 2.0]]))[0] == pytest.approx(-SHEET_M / 2)


@pytest.mark.parametrize("corners", [PANEL, FLAT])
def test_a_solid_without_volume_is_solid(corners):
    solid = Solid(np.array(corners), np.array(ONE_SIDE) - 1)
    stage = Stage(DARWIN, Pose2(5.0, 5.0, 0.0), {}, DARWIN.hip_m, 0.005, still=[solid])
    physics = PyBulletPhysics(stage)
    try:
        middle = np.array(solid.centre)
        normal = np.array([0.0, 1.0, 0.0]) if corners is PANEL else np.array([0.0, 0.0, 1.0])
        hit = physics._bullet.rayTest(
            (middle + 0.2 * normal).tolist(),
            (middle - 0.1 * normal).tolist(),
            physicsClientId=physics.client,
        )[0]
        assert hit[0] >= 0
        assert np.dot(np.array(hit[3]) - middle, normal) == pytest.approx(0.005, abs=2e-3)
    finally:
        physics.close()


BOX = '<robot name="r"><link name="a"><visual><origin {}/><geometry>{}</geometry></visual></link></robot>'
GOOD = '<box size="1 1 1"/>'


@pytest.mark.parametrize(
    ("origin", "shape", "said"),
    [
        ('xyz="a b c"', GOOD, r"xyz='a b c' of <origin>: .*'a'; expected 3 numbers"),
        ('xyz="1 2"', GOOD, "xyz='1 2' of <origin>: expected 3 numbers"),
        ('rpy="0 1"', GOOD, "rpy='0 1' of <origin>: expected 3 numbers"),
        ('xyz="0 nan 0"', GOOD, "xyz='0 nan 0' of <origin>: expected 3 numbers, none beyond 1000"),
        ("", '<box size="1 0 1"/>', "size='1 0 1' of <box>: expected 3 positive numbers"),
        ("", '<box size="1 -1 1"/>', "size='1 -1 1' of <box>"),
        ("", '<box size="1 nan 1"/>', "size='1 nan 1' of <box>"),
        ("", '<cylinder radius="0" length="1"/>', "radius='0' of <cylinder>: .*1 positive number"),
        ("", '<cylinder radius="1" length="-1"/>', "length='-1' of <cylinder>"),
        ("", '<sphere radius="inf"/>', "radius='inf' of <sphere>"),
        ("", '<sphere radius="-1"/>', "radius='-1' of <sphere>"),
        (
            "",
            '<mesh filename="package://p/gone.stl"/>',
            "gone.stl' of <mesh>: no such file; looked",
        ),
        ("", '<mesh filename="is.dae"/>', "is.dae' of <mesh>: .dae is not read; expected .obj"),
        ("", '<mesh filename="is.obj" scale="1 0 1"/>', "scale='1 0 1' of <mesh>: must not be 0"),
        ("", '<mesh filename="is.obj" scale="1 1"/>', "scale='1 1' of <mesh>: expected 3"),
    ],
)
def test_errors_in_a_urdf_are_reported(tmp_path, origin, shape, said):
    (tmp_path / "is.dae").write_text("")
    write_box(tmp_path / "is.obj", (1.0, 1.0, 1.0))
    (tmp_path / "r.urdf").write_text(BOX.format(origin, shape))
    with pytest.raises(InputError, match=said) as caught:
        read_model(tmp_path / "r.urdf")
    assert "r.urdf" in str(caught.value)


def test_a_mirrored_part_still_faces_outward(tmp_path):
    write_box(tmp_path / "is.obj", (0.4, 0.5, 0.6))
    shape = '<mesh filename="is.obj" scale="1 -1 1"/>'
    (tmp_path / "r.urdf").write_text(BOX.format("", shape))
    (solid,) = read_model(tmp_path / "r.urdf")
    assert volume(solid) == pytest.approx(0.4 * 0.5 * 0.6, rel=1e-5)


def test_meshes_that_cannot_be_used_are_refused(tmp_path):
    (tmp_path / "r.urdf").write_text(BOX.format("", GOOD))
    with pytest.raises(InputError, match=r"r.urdf: up = 'y'; a URDF is z up"):
        read_model(tmp_path / "r.urdf", up="y")
    line = write_obj(tmp_path / "a.obj", [(0, 0, 0), (1, 0, 0), (2, 1e-9, 0)], [(1, 2, 3)])
    with pytest.raises(InputError, match=r"a.obj: has no surface wider than 0.1 mm"):
        read_model(line)
    bad = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
    bad += "property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
    (tmp_path / "b.ply").write_text(bad + "0 0 0\n1 nan 0\n0 1 0\n3 0 1 2\n")
    with pytest.raises(InputError, match=r"b.ply: has vertices that are not finite"):
        read_model(tmp_path / "b.ply")


def test_a_missing_open3d_is_reported_with_what_to_install(tmp_path, monkeypatch):
    path = write_box(tmp_path / "a.obj", (1.0, 1.0, 1.0))
    real = builtins.__import__

    def absent(name, *rest):
        if name == "open3d":
            raise ImportError("libGL.so.1: cannot open shared object file")
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", absent)
    with pytest.raises(SurefootError, match=r"libGL.so.1.*apt-get install"):
        read_model(path)
