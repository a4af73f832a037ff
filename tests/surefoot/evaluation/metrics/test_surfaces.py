"""Figures of surfaces: planes at a known distance, incomplete maps, meshes."""

from __future__ import annotations

import numpy as np
import pytest

from perception.primitives.errors import InputError
from surefoot.evaluation.metrics.surfaces import read_surface, surface_metrics


def sheet(height: float, step: float = 0.005, width: float = 0.5) -> np.ndarray:
    x, y = np.meshgrid(np.arange(0, width, step), np.arange(0, 0.5, step))
    return np.column_stack([x.ravel(), y.ravel(), np.full(x.size, height)])


def test_the_distance_of_two_planes_is_the_accuracy():
    found = surface_metrics(sheet(0.015), sheet(0.0))
    assert found["accuracy_mm"] == pytest.approx(15.0)
    assert found["fscore_1cm"] == 0.0
    assert found["fscore_2cm"] == found["completeness_5cm"] == 1.0


def test_half_a_map_is_accurate_but_not_complete():
    true = sheet(0.0)
    half = sheet(0.0, width=0.25)
    found = surface_metrics(half, true)
    assert found["accuracy_mm"] == 0.0
    assert found["completeness_1cm"] == pytest.approx(0.52, abs=0.02)  # half, and 1 cm beside it


def test_a_true_mesh_is_sampled_on_its_surface(tmp_path):
    import open3d as o3d

    box = o3d.geometry.TriangleMesh.create_box(0.4, 0.3, 0.2)
    o3d.io.write_triangle_mesh(str(tmp_path / "box.ply"), box)
    points = read_surface(tmp_path / "box.ply")
    faces = np.stack([points, np.array([0.4, 0.3, 0.2]) - points])
    assert np.abs(faces).min(axis=(0, 2)).max() < 1e-6
    assert len(points) == pytest.approx(0.52 / 0.005**2, rel=0.01)
    np.testing.assert_array_equal(points, read_surface(tmp_path / "box.ply"))


def test_a_file_without_a_surface_is_refused(tmp_path):
    (tmp_path / "words.ply").write_text("not a mesh")
    for name in ("words.ply", "absent.ply"):
        with pytest.raises(InputError, match=name):
            read_surface(tmp_path / name)
    with pytest.raises(InputError, match="no points"):
        surface_metrics(np.zeros((0, 3)), sheet(0.0))
