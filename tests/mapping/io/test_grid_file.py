"""The terrain map as a file: saved and loaded maps update alike, and damage is reported."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapping.grid.confidence import ConfidenceConfig, ConfidenceLayer
from mapping.grid.egocentric_grid import EgocentricGrid, GridConfig
from mapping.grid.evidence import EvidenceConfig
from mapping.io import grid_file
from perception.primitives.errors import InputError, OutputError

SMALL = GridConfig(side_m=0.75, cell_m=0.05, evidence=EvidenceConfig(limit=3.0))


def walk(grid: EgocentricGrid, confidence: ConfidenceLayer, steps: int, seed: int) -> None:
    """Random steps and points that use every function of a grid."""
    rng = np.random.default_rng(seed)
    for k in range(steps):
        grid.move(grid.position + rng.uniform(-0.06, 0.09, 2))
        confidence.decay(0.3)
        confidence.see(rng.random((15, 15)) < 0.3)
        xyz = np.column_stack([grid.position + rng.uniform(-0.4, 0.4, (300, 2)), rng.random(300)])
        flags = xyz[:, 0] % 0.2 < 0.1
        moving = flags & (xyz[:, 1] > 0.1)
        grid.update(
            xyz,
            flags,
            1.0 + k,
            np.zeros(2),
            is_moving=moving,
            sensor_height_m=0.4,
            sigma_m=xyz[:, 2],
            sees_through=lambda places: places[:, 0] % 0.3 < 0.15,
        )
        grid.age(0.5)


def walked(seed: int) -> tuple[EgocentricGrid, ConfidenceLayer]:
    grid = EgocentricGrid(SMALL, np.array([1.0, -2.0]))
    confidence = ConfidenceLayer(grid, ConfidenceConfig(loss_per_s=0.05))
    walk(grid, confidence, 8, seed)
    return grid, confidence


def assert_same(a: EgocentricGrid, b: EgocentricGrid) -> None:
    assert a.config == b.config
    for name, value in a.snapshot().items():
        np.testing.assert_array_equal(b.snapshot()[name], value, err_msg=name)
    np.testing.assert_array_equal(a.origin, b.origin)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_updates_of_a_loaded_map_give_the_same_bits(tmp_path_factory, seed):
    grid, confidence = walked(seed)
    path = grid_file.save(tmp_path_factory.mktemp("map") / "terrain.npz", grid, confidence)
    loaded, freshness = grid_file.load(path)
    assert freshness is not None
    assert_same(grid, loaded)
    np.testing.assert_array_equal(freshness.values, confidence.values)
    assert freshness.config == confidence.config
    walk(grid, confidence, 5, seed + 1)
    walk(loaded, freshness, 5, seed + 1)
    assert_same(grid, loaded)
    np.testing.assert_array_equal(freshness.values, confidence.values)


def test_an_unused_map_without_confidence_is_saved_too(tmp_path):
    grid = EgocentricGrid(SMALL, np.zeros(2))
    loaded, freshness = grid_file.load(grid_file.save(tmp_path / "m.npz", grid))
    assert freshness is None
    assert_same(grid, loaded)


def test_the_file_is_plain_arrays_in_world_order(tmp_path):
    grid, confidence = walked(3)
    path = grid_file.save(tmp_path / "m.npz", grid, confidence)
    with np.load(path, allow_pickle=False) as file:
        np.testing.assert_allclose(1 / (1 + np.exp(-file["log_odds"])), grid.probability, rtol=1e-6)
        np.testing.assert_array_equal(file["height_m"], grid.height_m)
        assert json.loads(str(file["settings"]))["cell_m"] == 0.05
    again = grid_file.save(tmp_path / "again.npz", grid, confidence)
    assert again.read_bytes() == path.read_bytes()  # same map, same file


def rewrite(path: Path, **changed: np.ndarray | None) -> Path:
    """The file with some of its arrays replaced, or left out."""
    with np.load(path, allow_pickle=False) as file:
        content = {**{name: file[name] for name in file.files}, **changed}
    np.savez(path, **{name: value for name, value in content.items() if value is not None})
    return path


def with_settings(path: Path, **changed: object) -> Path:
    with np.load(path, allow_pickle=False) as file:
        values = json.loads(str(file["settings"]))
    return rewrite(path, settings=np.array(json.dumps({**values, **changed})))


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"format": np.array(9)}, "format 9, this version reads 3"),
        ({"format": None}, "no array 'format'"),
        ({"moving": None}, "no array 'moving'"),
        ({"settings": np.array("{")}, "settings cannot be used"),
        ({"log_odds": np.zeros((3, 3), np.float32)}, r"'log_odds' is float32 of shape \(3, 3\)"),
        ({"first": np.zeros(2)}, "'first' is float64"),
        ({"log_odds": np.full((15, 15), np.nan, np.float32)}, "log_odds, .* hold impossible"),
        ({"rest": np.array([0.3, 0.0])}, "rest hold impossible"),
        ({"start": np.array([np.inf, 0.0])}, "start, rest hold impossible"),
        ({"latest_s": np.array(np.nan)}, "latest_s hold impossible"),
        ({"updated_s": np.full((15, 15), np.inf)}, "updated_s hold impossible"),
        ({"moving": np.ones((15, 15), bool)}, "moving hold impossible"),
        ({"hanging": np.ones((15, 15), bool)}, "hanging hold impossible"),
        ({"height_variance_m2": np.full((15, 15), -1.0, np.float32)}, "height_variance_m2 hold"),
        ({"confidence": np.full((15, 15), 1.5, np.float32)}, r"confidence outside \[0, 1\]"),
        ({"confidence": np.zeros((2, 2), np.float32)}, "'confidence' is float32"),
    ],
)
def test_impossible_values_are_refused_by_name(tmp_path, changed, message):
    path = rewrite(grid_file.save(tmp_path / "m.npz", *walked(1)), **changed)
    with pytest.raises(InputError, match=message):
        grid_file.load(path)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"cell_m": -1.0}, "cell_m=-1"),
        ({"evidence": {"limit": -2.0}}, "limit=-2"),
        ({"colour": 3}, "colour"),
        ({"evidence": 3}, "settings cannot be used"),
        ({"confidence": {"loss_per_s": -1.0}}, "loss_per_s"),
        ({"confidence": None}, "confidence layer"),
    ],
)
def test_impossible_settings_are_refused_by_name(tmp_path, changed, message):
    path = with_settings(grid_file.save(tmp_path / "m.npz", *walked(1)), **changed)
    with pytest.raises(InputError, match=message):
        grid_file.load(path)


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    grid, confidence = walked(2)
    path = grid_file.save(tmp_path_factory.mktemp("map") / "damaged.npz", grid, confidence)
    return grid, path, path.read_bytes()


@settings(max_examples=150, deadline=None)
@given(st.data())
def test_a_damaged_file_is_refused_or_reads_the_same(saved, data):
    grid, path, whole = saved
    content = bytearray(whole)
    where = data.draw(st.integers(0, len(content) - 1))
    if data.draw(st.booleans()):
        del content[where:]
    else:
        content[where] ^= data.draw(st.integers(1, 255))
    path.write_bytes(bytes(content))
    try:
        loaded, _ = grid_file.load(path)
    except InputError:
        return
    assert_same(grid, loaded)  # no content depends on that byte


def test_a_file_that_is_no_map_is_refused(tmp_path):
    with pytest.raises(InputError, match="cannot be read: No such file"):
        grid_file.load(tmp_path / "none.npz")
    np.save(tmp_path / "one.npy", np.zeros(3))
    with pytest.raises(InputError, match=r"no \.npz of NumPy"):
        grid_file.load(tmp_path / "one.npy")
    (tmp_path / "text.npz").write_text("terrain")
    with pytest.raises(InputError, match="damaged"):
        grid_file.load(tmp_path / "text.npz")
    np.savez(tmp_path / "pickled.npz", format=np.array([{}], dtype=object))
    with pytest.raises(InputError, match="damaged"):
        grid_file.load(tmp_path / "pickled.npz")


def test_a_failed_write_is_reported_and_keeps_the_old_file(tmp_path, monkeypatch):
    grid, confidence = walked(4)
    with pytest.raises(OutputError, match="cannot write"):
        grid_file.save(tmp_path / "no" / "m.npz", grid)
    with pytest.raises(InputError, match=r"ends in \.npz"):
        grid_file.save(tmp_path / "m.txt", grid)
    path = grid_file.save(tmp_path / "m.npz", grid, confidence)
    before = path.read_bytes()

    def full(_: int) -> None:
        raise OSError(28, os.strerror(28))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OutputError, match="No space left"):
        grid_file.save(path, EgocentricGrid(SMALL, np.zeros(2)))
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["m.npz"]
