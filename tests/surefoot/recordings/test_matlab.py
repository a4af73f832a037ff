"""Tables of MATLAB files against SciPy, and files that end SciPy's reader are refused."""

from __future__ import annotations

import struct
import zlib

import numpy as np
import pytest
from scipy.io import loadmat, savemat

from perception.primitives.errors import RecordingError
from perception.primitives.safe_input import UnreadableError
from surefoot.recordings import matlab
from surefoot.recordings.matlab import read_tables
from surefoot.recordings.plaza import read_plaza

TABLES = {
    "DR": np.random.default_rng(0).normal(size=(7, 3)),
    "small": np.array([[1.0]]),
    "bytes": np.arange(6, dtype=np.uint8).reshape(2, 3),
    "words": np.arange(6, dtype=np.int32).reshape(3, 2),
    "single": np.ones((2, 2), np.float32) / 3,
    "none": np.empty((0, 4)),
    "text": "left out",
    "complex": np.array([[1j]]),
    "cell": np.array([[1, "a"]], dtype=object),
}


@pytest.mark.parametrize("packed", [False, True])
def test_every_real_matrix_is_read_as_scipy_reads_it(tmp_path, packed):
    savemat(tmp_path / "a.mat", TABLES, do_compression=packed)
    theirs, ours = loadmat(tmp_path / "a.mat"), read_tables(tmp_path / "a.mat")
    assert set(ours) == {"DR", "small", "bytes", "words", "single", "none"}
    for name, table in ours.items():
        np.testing.assert_array_equal(table, theirs[name])


def test_a_real_recording_is_read_as_scipy_reads_it(recordings):
    path = recordings / "plaza1_range" / "Plaza1_.mat"
    theirs = loadmat(path)
    for name, table in read_tables(path).items():
        np.testing.assert_array_equal(table, theirs[name])


def test_files_that_are_none_are_refused(tmp_path, monkeypatch):
    path = tmp_path / "a.mat"
    savemat(path, {"DR": np.ones((50, 3))})
    whole = path.read_bytes()
    sizes = struct.pack("<II", 5, 8) + struct.pack("<ii", 50, 3)
    assert sizes in whole
    for content, words in (
        (b"", "no MATLAB file"),
        (b"x" * 500, "no MATLAB file"),
        (whole[:-8], "cut off"),
        (whole.replace(sizes, sizes[:8] + struct.pack("<ii", 50, -3)), "another size"),
        (whole.replace(sizes, sizes[:8] + struct.pack("<ii", 2**31 - 1, 2**31 - 1)), "another size"),
        (whole[:128] + struct.pack("<II", 15, 5) + b"12345", "is damaged"),
    ):  # fmt: skip
        path.write_bytes(content)
        with pytest.raises(UnreadableError, match=words):
            read_tables(path)
    monkeypatch.setattr(matlab, "MOST_BYTES", 1 << 16)
    bomb = zlib.compress(bytes(1 << 20))
    path.write_bytes(whole[:128] + struct.pack("<II", 15, len(bomb)) + bomb)
    with pytest.raises(UnreadableError, match="unpacks to more"):
        read_tables(path)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"TL": np.ones((2, 2))}, "no table TL of 3 columns"),
        ({"DR": np.full((2, 3), np.nan)}, "table DR holds numbers that are not finite"),
        ({"TD": np.empty((0, 4))}, "no table TD"),
    ],
)
def test_a_log_without_a_usable_table_is_refused_by_its_name(tmp_path, changed, words):
    good = {"DR": np.ones((2, 3)), "TD": np.ones((2, 4)), "TL": np.ones((1, 3))}
    savemat(tmp_path / "a.mat", good | changed)
    with pytest.raises(RecordingError, match=words):
        read_plaza(tmp_path / "a.mat")
