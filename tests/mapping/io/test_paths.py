"""Every loader and writer takes the name of a file or folder as text or as a Path."""

from __future__ import annotations

import gzip
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from mapping.grid.egocentric_grid import EgocentricGrid, GridConfig
from mapping.grid.world_map import WorldMap
from mapping.io import clouds, geotiff, grid_file, ground_file, nav2, ply, world_file
from mapping.surface import meshes, traversability
from perception.primitives import mesh_reader, safe_input
from perception.primitives.errors import OutputError, SurefootError

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

GRID = EgocentricGrid(GridConfig(side_m=0.75, cell_m=0.05), np.zeros(2))
CELLS, KNOWN = np.array([[0.1, 0.9]], np.float32), np.ones((1, 2), np.bool_)
CORNERS = np.eye(3, dtype=np.float32)
MESH = meshes.Mesh(CORNERS, np.array([[0, 1, 2]], np.int32), CORNERS)
WRITERS: dict[str, Callable[[str | Path], object]] = {
    "points.ply": lambda name: clouds.save_ply(name, np.eye(3)),
    "layers.tif": lambda name: geotiff.save(name, {"p": CELLS}, np.zeros(2), 0.05),
    "grid.npz": lambda name: grid_file.save(name, GRID),
    "mesh.ply": lambda name: meshes.save_mesh(name, MESH),
    "layers.npz": lambda name: traversability.save_layers(
        name, traversability.traversability(MESH)
    ),
}
FOLDERS: dict[str, Callable[[str | Path], object]] = {
    "nav2": lambda name: nav2.save(name, "m", CELLS, KNOWN, np.zeros(2), 0.05),
    "nav2 scale": lambda name: nav2.save_scale(name, "m", CELLS, KNOWN, np.zeros(2), 0.05),
    "world": lambda name: world_file.save(name, WorldMap()),
    "traversability": lambda name: traversability.save_nav2(
        name, "m", traversability.traversability(MESH)
    ),
}


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


@pytest.mark.parametrize("name", WRITERS)
def test_a_file_is_written_to_a_name_as_text(name, tmp_path):
    for folder in ("text", "path"):
        (tmp_path / folder).mkdir()
    WRITERS[name](str(tmp_path / "text" / name))
    WRITERS[name](tmp_path / "path" / name)
    assert (tmp_path / "text" / name).stat().st_size == (tmp_path / "path" / name).stat().st_size
    with pytest.raises(OutputError, match="check the folder"):
        WRITERS[name](str(tmp_path / "absent" / name))


@pytest.mark.parametrize("name", FOLDERS)
def test_a_map_is_written_to_a_folder_as_text(name, tmp_path):
    folders = tmp_path / "text", tmp_path / "path"
    for folder, place in zip(folders, (str(folders[0]), folders[1]), strict=True):
        folder.mkdir()
        FOLDERS[name](place)
    written = [{one.name: one.read_bytes() for one in folder.iterdir()} for folder in folders]
    assert written[0]
    assert written[0] == written[1]
