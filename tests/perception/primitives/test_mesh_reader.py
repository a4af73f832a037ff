"""Meshes are read in a process of their own: a damaged file is an error, and the next file is read."""

from __future__ import annotations

import os

import numpy as np
import pytest

from perception.primitives import mesh_reader
from perception.primitives.mesh_reader import MeshError, read

HEADER = (
    "ply\nformat {kind} 1.0\nelement vertex {vertices}\nproperty float x\nproperty float y\n"
    "property float z\nelement face {faces}\nproperty list uchar int vertex_indices\nend_header\n"
)
CORNERS = "0 0 0\n1 0 0\n0 1 0\n"


def ply(path, body, vertices=3, faces=1, kind="ascii"):
    head = HEADER.format(kind=kind, vertices=vertices, faces=faces).encode()
    path.write_bytes(head + (body if isinstance(body, bytes) else body.encode()))
    return path


def test_meshes_and_clouds_are_read_exactly(tmp_path):
    import open3d as o3d

    ball = o3d.geometry.TriangleMesh.create_sphere(0.3, 15)
    o3d.io.write_triangle_mesh(str(tmp_path / "ball.ply"), ball)
    found = read(tmp_path / "ball.ply")
    np.testing.assert_array_equal(found.vertices, np.asarray(ball.vertices))
    np.testing.assert_array_equal(found.triangles, np.asarray(ball.triangles))
    o3d.io.write_point_cloud(str(tmp_path / "ball.pcd"), ball.sample_points_uniformly(50))
    cloud = read(tmp_path / "ball.pcd")
    assert cloud.vertices.shape == (50, 3)
    assert cloud.triangles.shape == (0, 3)


def test_damaged_files_are_errors_and_the_next_file_is_read(tmp_path):
    good = ply(tmp_path / "good.ply", CORNERS + "3 0 1 2\n")
    rng = np.random.default_rng(1)
    binary = rng.normal(size=(300, 3)).astype("<f4").tobytes()
    faces = b"".join(b"\3" + rng.integers(0, 300, 3).astype("<i4").tobytes() for _ in range(200))
    damaged = [
        ply(tmp_path / "cut.ply", (binary + faces)[:-900], 300, 200, "binary_little_endian"),
        ply(tmp_path / "shifted.ply", binary[7:] + faces, 300, 200, "binary_little_endian"),
        ply(tmp_path / "word.ply", CORNERS.replace("1 0 0", "a" * 3000 + " 0 0") + "3 0 1 2\n"),
        ply(tmp_path / "index.ply", CORNERS + "3 0 1 70000\n"),
        ply(tmp_path / "nan.ply", CORNERS.replace("1 0 0", "nan 0 0") + "3 0 1 2\n"),
        ply(tmp_path / "far.ply", CORNERS.replace("1 0 0", "1e30 0 0") + "3 0 1 2\n"),
    ]
    (tmp_path / "half.off").write_text("OFF\n3 2 0\n" + CORNERS + "3 0 1 2\n3 0")
    (tmp_path / "huge.off").write_text("OFF\n3000000000 1 0\n0 0 0\n")
    (tmp_path / "words.ply").write_text("not a mesh")
    damaged += [
        tmp_path / "half.off",
        tmp_path / "huge.off",
        tmp_path / "words.ply",
        tmp_path / "absent.ply",
    ]
    refused = set()
    for path in damaged:
        try:
            assert np.isfinite(read(path).vertices).all()  # of what is left of it
        except MeshError:
            refused.add(path.stem)
        assert read(good).vertices.shape == (3, 3), path
    assert refused == {path.stem for path in damaged}


def test_a_file_that_takes_too_long_is_given_up(tmp_path, monkeypatch):
    good = ply(tmp_path / "good.ply", CORNERS + "3 0 1 2\n")
    read(good)
    endless = tmp_path / "endless.ply"
    os.mkfifo(endless)  # nobody writes into it
    monkeypatch.setattr(mesh_reader, "MOST_SECONDS", 0.3)
    with pytest.raises(MeshError, match="takes more than"):
        read(endless)
    monkeypatch.undo()
    assert len(read(good).triangles) == 1
