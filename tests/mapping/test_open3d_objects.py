"""Open3D objects hold what the maps hold, and files give it back."""

from __future__ import annotations

import numpy as np
import pytest

from mapping import open3d_objects
from mapping.grid.egocentric_grid import EgocentricGrid, GridConfig
from mapping.grid.world_map import WorldMap
from mapping.io.clouds import CloudBuilder, save_ply
from mapping.panorama.rendering import Drawing
from mapping.panorama.sphere import Sphere
from perception.primitives.errors import InputError

open3d = pytest.importorskip("open3d", reason="Open3D cannot be loaded here", exc_type=ImportError)
CAMERA = np.array([0.0, 0.0, 0.5])


def filled(found: EgocentricGrid | WorldMap) -> EgocentricGrid | WorldMap:
    """Floor on one side, a box 0.2 m high on the other."""
    x, y = (v.ravel() for v in np.meshgrid(np.arange(-0.5, 0.5, 0.02), np.arange(-0.5, 0.5, 0.02)))
    box = x > 0.2
    points = np.stack([x, y, np.where(box, 0.2, 0.0)], axis=1)
    for k in range(4):
        camera = CAMERA if isinstance(found, WorldMap) else CAMERA[:2]
        found.update(points, box, 0.1 * k, camera)
    return found


@pytest.mark.parametrize("make", [lambda: EgocentricGrid(GridConfig(), np.zeros(2)), WorldMap])
def test_layers_and_heights_of_a_map_are_those_of_its_tensors_and_its_mesh(make):
    found = filled(make())
    tensors = found.to_open3d()
    for name, tensor in tensors.items():
        np.testing.assert_array_equal(tensor.numpy(), getattr(found, name))
    mesh = open3d_objects.height_mesh(found)
    squares = mesh.vertex.positions.numpy().reshape(-1, 4, 3)
    assert len(squares) == np.count_nonzero(found.known & np.isfinite(found.height_m))
    middle = squares.mean(axis=1)
    row, column = found.cell_of(middle[:, :2].astype(float)).T
    np.testing.assert_array_equal(middle[:, 2], found.height_m[row, column])
    box = middle[:, 2] > 0.1
    assert box.any()
    assert (middle[box, 0] > 0.15).all()
    area = mesh.to_legacy().get_surface_area()
    assert area == pytest.approx(len(squares) * found.cell_m**2, rel=1e-4)
    red = mesh.vertex["colors"].numpy().reshape(-1, 4, 3)[:, 0]
    assert red[box, 1].max() < 0.5 < red[~box, 1].min()


def test_a_tensor_shares_the_memory_of_its_layer():
    values = np.zeros((4, 4), np.float32)
    cloud = open3d_objects.point_cloud(np.zeros((16, 3)), None, {"sigma": values.ravel()})
    values[0, 1] = 7.0
    assert cloud.point["sigma"][1].item() == 7.0


def test_a_cloud_is_saved_with_its_attributes_and_read_back(tmp_path):
    rng = np.random.default_rng(0)
    points = rng.uniform(-1.0, 1.0, (50, 3))
    builder = CloudBuilder()
    for _ in range(3):
        builder.add(points, rng.integers(0, 256, (50, 3)).astype(np.uint8))
    cloud = builder.to_open3d()
    assert set(cloud.point["sightings"].numpy().ravel().tolist()) == {3}
    attributes = {
        "sigma": rng.uniform(size=50),
        "stamp": 1.7e9 + rng.uniform(size=50),
        "sightings": builder.sightings,
    }
    save_ply(tmp_path / "a.ply", points, None, attributes)
    read = open3d.t.io.read_point_cloud(str(tmp_path / "a.ply"))
    np.testing.assert_array_equal(read.point.positions.numpy(), points)
    for name, values in attributes.items():
        np.testing.assert_array_equal(read.point[name].numpy().ravel(), values)
    with pytest.raises(InputError, match="sigma has 2 values for 50 points"):
        open3d_objects.point_cloud(points, None, {"sigma": np.zeros(2)})


def test_a_panorama_is_a_cloud_with_sigma_stamp_and_view():
    sphere = Sphere(8, 4, 2.0, 0.0, 0.0)
    range_m = np.full((4, 8), np.nan, np.float32)
    range_m[1, 2:5] = [1.0, 2.0, 3.0]
    sigma = np.full((4, 8), 0.01, np.float32) * np.arange(8, dtype=np.float32)
    stamp, view = np.full((4, 8), 5.0), np.tile(np.arange(8), (4, 1))
    drawn = Drawing(sphere, np.array([0.0, 0.0, 0.5]), range_m, sigma, stamp, view)
    cloud = drawn.to_open3d()
    away = np.linalg.norm(cloud.point.positions.numpy() - drawn.centre, axis=1)
    np.testing.assert_allclose(away, [1.0, 2.0, 3.0], rtol=1e-6)
    np.testing.assert_allclose(cloud.point["sigma"].numpy().ravel(), [0.02, 0.03, 0.04], rtol=1e-6)
    assert cloud.point["view"].numpy().ravel().tolist() == [2, 3, 4]
    assert (cloud.point["stamp"].numpy() == 5.0).all()
