"""Every loader takes the name of a file as text or as a Path."""

from __future__ import annotations

import gzip
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from mapping.grid.egocentric_grid import EgocentricGrid, GridConfig
from mapping.io import clouds, geotiff, grid_file, ground_file, nav2, ply
from mapping.surface import meshes, traversability
from perception.primitives import mesh_reader, safe_input
from perception.primitives.errors import SurefootError

LOADERS: list[Callable[[str | Path], object]] = [
    clouds.load_ply,
    geotiff.load,
    grid_file.load,
    ground_file.load,
    mesh_reader.read,
    meshes.load_mesh,
    nav2.load,
    ply.read_mesh,
    ply.read_points,
    safe_input.arrays,
    safe_input.data,
    safe_input.table,
    safe_input.text,
    traversability.load_layers,
]


def fault(load: Callable[[str | Path], object], path: str | Path) -> tuple[type, str]:
    try:
        load(path)
    except (SurefootError, ValueError) as error:
        return type(error), str(error)
    pytest.fail(f"{path} was read")


@pytest.mark.parametrize("load", LOADERS, ids=lambda load: f"{load.__module__}.{load.__name__}")
def test_a_name_as_text_is_refused_in_the_words_of_a_path(load, tmp_path):
    for place in (tmp_path / "none.npz", tmp_path):
        assert fault(load, str(place)) == fault(load, place)


def test_maps_are_loaded_by_a_name_as_text(tmp_path):
    grid = EgocentricGrid(GridConfig(side_m=0.75, cell_m=0.05), np.zeros(2))
    loaded, confidence = grid_file.load(str(grid_file.save(tmp_path / "a.npz", grid)))
    assert loaded.config == grid.config
    assert confidence is None
    cells = np.array([[0.1, 0.9]], np.float32)
    saved = nav2.save(tmp_path, "m", cells, np.ones((1, 2), bool), np.zeros(2), 0.05)
    np.testing.assert_array_equal(nav2.load(str(saved)).probability, [[0.0, 1.0]])


def test_zipped_text_is_read_by_a_name_as_text(tmp_path):
    (tmp_path / "a.csv.gz").write_bytes(gzip.compress(b"1 2\n"))
    np.testing.assert_array_equal(safe_input.table(str(tmp_path / "a.csv.gz")), [[1.0, 2.0]])
