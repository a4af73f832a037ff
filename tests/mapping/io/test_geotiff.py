"""Layers as GeoTIFF: read back, read by OpenCV, and with the tags of the standard."""

from __future__ import annotations

import struct
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapping.grid.world_map import WorldMap
from mapping.io import geotiff, nav2, world_file
from perception.primitives.errors import InputError


def layers(rows: int, columns: int, seed: int = 0) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(seed)
    made = {
        name: rng.normal(size=(rows, columns)).astype(np.float32) for name in ("a", "b < c", "d")
    }
    made["b < c"][rng.random((rows, columns)) < 0.3] = np.nan
    return made


@settings(max_examples=20, deadline=None)
@given(st.integers(1, 9), st.integers(1, 9), st.floats(-50, 50), st.floats(-50, 50))
def test_saved_layers_are_read_back(tmp_path_factory, rows, columns, x, y):
    path = tmp_path_factory.mktemp("map") / "m.tif"
    made = layers(rows, columns)
    read, origin, cell_m = geotiff.load(geotiff.save(path, made, np.array([x, y]), 0.05))
    assert list(read) == list(made)
    for name, layer in made.items():
        np.testing.assert_array_equal(read[name], layer)
    np.testing.assert_allclose(origin, [x, y], atol=1e-12)
    assert cell_m == 0.05


def test_opencv_reads_the_bands_with_the_largest_y_at_the_top(tmp_path: Path) -> None:
    made = layers(5, 7)
    image = cv2.imread(
        str(geotiff.save(tmp_path / "m.tif", made, np.zeros(2), 0.05)), cv2.IMREAD_UNCHANGED
    )
    expected = np.stack(list(made.values())[::-1], axis=-1)[::-1]  # OpenCV: last band first
    np.testing.assert_array_equal(image, expected)


def test_the_tie_point_is_the_upper_left_corner_and_the_axes_are_local_metres(
    tmp_path: Path,
) -> None:
    path = geotiff.save(tmp_path / "m.tif", layers(4, 7), np.array([-1.25, 2.5]), 0.05)
    tags = geotiff._tags(path.read_bytes())
    assert tags[33922] == (0.0, 0.0, 0.0, -1.25, 2.5 + 4 * 0.05, 0.0)
    assert tags[33550] == (0.05, 0.05, 0.0)
    keys = np.array(tags[34735]).reshape(-1, 4)
    assert keys[0].tolist() == [1, 1, 0, len(keys) - 1]
    assert np.all(np.diff(keys[1:, 0]) > 0)  # the standard sorts them
    values = {int(key): int(value) for key, _, _, value in keys[1:]}
    assert (values[1024], values[1025], values[3076]) == (32767, 1, 9001)
    assert [struct.calcsize("f") * 8] * 3 == list(tags[258])


def test_foreign_and_damaged_files_are_refused(tmp_path: Path) -> None:
    for content in (
        b"",
        b"II*\0",
        b"MM\0*" + bytes(40),
        b"II*\0" + struct.pack("<IH", 8, 0) + bytes(4),
    ):
        (tmp_path / "m.tif").write_bytes(content)
        with pytest.raises(InputError, match=r"expected map_layers\.tif"):
            geotiff.load(tmp_path / "m.tif")
    path = geotiff.save(tmp_path / "w.tif", layers(2, 3), np.zeros(2), 0.05)
    content = bytearray(path.read_bytes())
    assert struct.unpack_from("<HH", content, 10) == (256, 4)  # the width, a long integer
    struct.pack_into("<H", content, 12, 12)  # a double
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"expected map_layers\.tif"):
        geotiff.load(path)
    with pytest.raises(InputError, match="cannot be read"):
        geotiff.load(tmp_path / "none.tif")
    with pytest.raises(InputError, match=r"ends in \.tif"):
        geotiff.save(tmp_path / "m.png", layers(1, 1), np.zeros(2), 0.05)
    with pytest.raises(InputError, match="one shape"):
        geotiff.save(
            tmp_path / "m.tif",
            layers(1, 1) | {"e": np.zeros((2, 2), np.float32)},
            np.zeros(2),
            0.05,
        )


def test_the_files_of_a_world_map_agree_with_it(tmp_path: Path) -> None:
    world = WorldMap()
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-1, 1, (20000, 2)), np.zeros(20000)])
    flags = points[:, 0] > 0.5
    points[flags, 2] = 0.2
    world.update(points, flags, 1.0, np.array([-2.0, 0.0, 1.0]))
    world_file.save(tmp_path, world)
    read, origin, cell_m = geotiff.load(tmp_path / world_file.LAYERS)
    row, column = np.floor((np.array([0.1, 0.8]) - origin[::-1]) / cell_m).astype(int)
    assert read["occupancy"][row, column] > 0.8
    assert read["height_m"][row, column] == pytest.approx(0.2, abs=1e-6)
    assert read["height_variance_m2"][row, column] > 0.0
    np.testing.assert_array_equal(np.isfinite(read["occupancy"]), world.known)
    np.testing.assert_array_equal(nav2.load(tmp_path / "map_probability.yaml").known, world.known)
    world_file.save(tmp_path, WorldMap())  # an empty one
    assert np.isnan(geotiff.load(tmp_path / world_file.LAYERS)[0]["occupancy"]).all()
