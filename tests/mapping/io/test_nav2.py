"""Maps as files of map_server: written, read, and read by OpenCV."""

from __future__ import annotations

import os
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapping.io import nav2
from perception.primitives.errors import InputError, OutputError


def write(folder: Path, yaml: str, pgm: bytes = b"P5\n2 2\n255\n\x00\xfe\xcd\x80") -> Path:
    (folder / "m.pgm").write_bytes(pgm)
    (folder / "m.yaml").write_text(yaml)
    return folder / "m.yaml"


GOOD = "image: m.pgm\nresolution: 0.05\norigin: [-1.0, 2.0, 0.0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"


@settings(max_examples=25, deadline=None)
@given(
    st.integers(1, 12),
    st.integers(1, 12),
    st.tuples(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3)),
    st.sampled_from([0.05, 0.02, 0.1]),
)
def test_a_saved_map_is_loaded_unchanged(tmp_path_factory, rows, columns, origin, cell_m):
    folder = tmp_path_factory.mktemp("map")
    rng = np.random.default_rng(rows * 100 + columns)
    state = rng.integers(0, 3, (rows, columns))  # free, occupied, unknown
    p = np.array([0.1, 0.9, 0.3], np.float32)[state]
    path = nav2.save(folder, "m", p, state != 2, np.array(origin), cell_m)
    loaded = nav2.load(path)
    np.testing.assert_array_equal(loaded.known, state != 2)
    np.testing.assert_array_equal(loaded.probability, np.array([0.0, 1.0, 0.5], np.float32)[state])
    np.testing.assert_array_equal(loaded.origin, origin)
    assert loaded.cell_m == cell_m
    assert sorted(f.name for f in folder.iterdir()) == ["m.pgm", "m.yaml"]


def test_the_image_shows_the_largest_y_at_the_top_in_map_server_grey_values(tmp_path):
    p = np.array([[0.05, 0.95, 0.05], [0.05, 0.05, 0.5]], np.float32)
    known = np.array([[True, True, False], [True, True, True]])
    nav2.save(tmp_path, "m", p, known, np.zeros(2), 0.05)
    image = cv2.imread(str(tmp_path / "m.pgm"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(image, [[254, 254, 205], [254, 0, 205]])


def test_unknown_pixels_lie_between_the_thresholds(tmp_path):
    # 205 is p = 50/255 = 0.19608; a reader with a higher free_thresh reads it as free.
    path = nav2.save(
        tmp_path, "m", np.zeros((1, 1), np.float32), np.zeros((1, 1), bool), np.zeros(2), 0.05
    )
    entries = dict(line.split(": ") for line in path.read_text().splitlines())
    assert float(entries["free_thresh"]) < 50 / 255 < float(entries["occupied_thresh"])


def test_an_empty_map_is_one_unknown_cell(tmp_path):
    empty = np.zeros((0, 0))
    path = nav2.save(tmp_path, "m", empty.astype(np.float32), empty.astype(bool), np.zeros(2), 0.05)
    assert not nav2.load(path).known.any()


def test_maps_of_other_writers_are_read(tmp_path):
    commented = b"P5\n# CREATOR: map_saver 0.05 m/pix\n2 2\n255\n\x00\xfe\xcd\x80"
    trinary = nav2.load(write(tmp_path, GOOD + "mode: trinary  # usual\n", commented))
    np.testing.assert_array_equal(trinary.probability, [[0.5, 0.5], [1.0, 0.0]])
    np.testing.assert_array_equal(trinary.known, [[False, False], [True, True]])
    negated = nav2.load(write(tmp_path, GOOD.replace("negate: 0", "negate: 1")))
    assert negated.probability[1, 0] == 0.0
    scale = nav2.load(write(tmp_path, GOOD + "mode: scale\n"))
    # map_server: linear from the one threshold to the other
    darkness = 1 - 128 / 255
    assert scale.probability[0, 1] == pytest.approx((darkness - 0.196) / (0.65 - 0.196), rel=1e-5)
    assert scale.probability[1].tolist() == [1.0, 0.0]


@pytest.mark.parametrize("save", [nav2.save, nav2.save_scale])
def test_a_yaml_reader_finds_numbers_whatever_their_size_and_type(tmp_path, save):
    yaml = pytest.importorskip("yaml")
    known = np.ones((1, 1), np.bool_)
    origin = np.array([-5e-05, 1234567.25])
    path = save(tmp_path, "m", np.ones((1, 1), np.float32), known, origin, np.float64(0.05))
    entries = yaml.safe_load(path.read_text())
    assert entries["resolution"] == 0.05
    assert entries["origin"] == [-5e-05, 1234567.25, 0.0]
    assert nav2.load(path).cell_m == 0.05


@pytest.mark.parametrize(
    ("yaml", "pgm", "message"),
    [
        (GOOD.replace("resolution: 0.05\n", ""), None, "no resolution"),
        (GOOD.replace("0.05", "fine"), None, "resolution='fine' must be a number"),
        (GOOD.replace("0.05", "-1"), None, "must be positive"),
        (GOOD.replace("0.0]", "0.7]"), None, r"rotated by 0\.7 rad"),
        (GOOD.replace("[-1.0, 2.0, 0.0]", "[1.0]"), None, "must be"),
        (GOOD.replace("m.pgm", "other.pgm"), None, "other.pgm cannot be read"),
        (GOOD + "mode: raw\n", None, "mode 'raw' is not supported"),
        (GOOD, b"P5\n4 4\n255\n\x00\x01", "2 bytes of pixels, expected 16"),
        (GOOD, b"P2\n1 1\n255\n7", r"expected a binary PGM \(P5\)"),
        (GOOD, b"", r"expected a binary PGM \(P5\)"),
        (GOOD, b"P5\n" + b"9" * 5000 + b" 4\n255\n\0", r"expected a binary PGM \(P5\)"),
    ],
)
def test_bad_maps_are_refused_with_their_reason(tmp_path, yaml, pgm, message):
    path = write(tmp_path, yaml) if pgm is None else write(tmp_path, yaml, pgm)
    with pytest.raises(InputError, match=message):
        nav2.load(path)


def test_a_missing_map_and_a_missing_folder_are_reported(tmp_path):
    with pytest.raises(InputError, match=r"none\.yaml cannot be read"):
        nav2.load(tmp_path / "none.yaml")
    with pytest.raises(OutputError, match=r"cannot write .*m\.pgm"):
        nav2.save(
            tmp_path / "no",
            "m",
            np.ones((1, 1), np.float32),
            np.ones((1, 1), bool),
            np.zeros(2),
            0.05,
        )


def test_a_failed_write_keeps_the_old_map(tmp_path, monkeypatch):
    one = (np.ones((1, 1), np.float32), np.ones((1, 1), bool), np.zeros(2), 0.05)
    path = nav2.save(tmp_path, "m", *one)
    before = {f.name: f.read_bytes() for f in tmp_path.iterdir()}

    def full(_: int) -> None:
        raise OSError(28, os.strerror(28))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OutputError, match="No space left"):
        nav2.save(
            tmp_path, "m", np.zeros((9, 9), np.float32), np.ones((9, 9), bool), np.zeros(2), 0.05
        )
    assert {f.name: f.read_bytes() for f in tmp_path.iterdir()} == before
    assert nav2.load(path).probability[0, 0] == 1.0


def test_a_map_of_probabilities_keeps_them_to_a_grey_value_and_what_was_not_seen(tmp_path):
    rng = np.random.default_rng(1)
    p, known = rng.random((6, 9)).astype(np.float32), rng.random((6, 9)) < 0.7
    loaded = nav2.load(nav2.save_scale(tmp_path, "m", p, known, np.array([-1.0, 2.0]), 0.05))
    np.testing.assert_array_equal(loaded.known, known)
    np.testing.assert_allclose(loaded.probability[known], p[known], atol=0.5 / 255 + 1e-6)
    assert np.all(loaded.probability[~known] == 0.5)


def test_nav2_reads_probabilities_as_occupancies_in_percent(tmp_path):
    """As map_io.cpp does: transparent is -1, else the share between the thresholds times 100."""
    p = np.array([[0.0, 0.3, 0.8, 1.0]], np.float32)
    known = np.array([[True, True, True, False]])
    path = nav2.save_scale(tmp_path, "m", p, known, np.zeros(2), 0.05)
    entries = dict(line.split(": ") for line in path.read_text().splitlines())
    free, occupied = float(entries["free_thresh"]), float(entries["occupied_thresh"])
    image = cv2.imread(str(tmp_path / entries["image"]), cv2.IMREAD_UNCHANGED)
    darkness = 1.0 - image[0, :, :3].mean(axis=-1) / 255.0
    cells = np.rint(100.0 * (darkness - free) / (occupied - free))
    cells[image[0, :, 3] < 255] = -1
    assert entries["mode"] == "scale"
    np.testing.assert_array_equal(cells, [0, 30, 80, -1])


def test_a_broken_picture_of_a_map_is_refused(tmp_path):
    (tmp_path / "m.png").write_bytes(b"no picture")
    (tmp_path / "m.yaml").write_text(GOOD.replace("m.pgm", "m.png"))
    with pytest.raises(InputError, match=r"m\.png: cannot be decoded"):
        nav2.load(tmp_path / "m.yaml")
