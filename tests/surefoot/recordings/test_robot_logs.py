"""MRCLAM and Plaza files: their content, and errors of damaged ones."""

from __future__ import annotations

import gzip
import shutil
from pathlib import Path

import gtsam
import numpy as np
import pytest
from scipy.io import savemat

from perception.primitives.errors import RecordingError
from surefoot.recordings import mrclam
from surefoot.recordings.plaza import read_plaza

LINES = {
    "Barcodes.dat": "# subject, barcode\n 1 5\n 6 63\n",
    "Landmark_Groundtruth.dat": " 6 0.5 -4.0 0.0 0.0\n",
    "Robot1_Measurement.dat": " 10.0 63 2.0 0.1\n 11.0 99 3.0 0.2\n",
    "Robot1_Odometry.dat": " 9.0 0.1 0.0\n 10.0 0.1 0.2\n",
    "Robot1_Groundtruth.dat": " 9.0 0.0 0.0 3.1\n 10.0 0.1 0.0 -3.1\n",
}


@pytest.fixture
def folder(tmp_path):
    for name, text in LINES.items():
        (tmp_path / name).write_text(text)
    return tmp_path


def test_barcodes_become_subjects_and_unknown_ones_zero(folder):
    log = mrclam.read_robot(folder, 1)
    assert log.subjects.tolist() == [6, 0]
    np.testing.assert_array_equal(log.seen, [[2.0, 0.1], [3.0, 0.2]])
    assert mrclam.read_landmarks(folder) == {6: (0.5, -4.0)}


def test_the_true_heading_is_unwrapped(folder):
    assert abs(np.diff(mrclam.read_truth(folder, 1)[:, 3])[0]) < 0.1


def test_a_gzipped_file_gives_the_same_table(folder):
    plain = mrclam.read_robot(folder, 1)
    path = folder / "Robot1_Odometry.dat"
    with path.open("rb") as source, gzip.open(f"{path}.gz", "wb") as target:
        shutil.copyfileobj(source, target)
    path.unlink()
    np.testing.assert_array_equal(mrclam.read_robot(folder, 1).odometry, plain.odometry)


@pytest.mark.parametrize(
    ("name", "text", "match"),
    [
        ("Robot1_Odometry.dat", " 9.0 0.1\n", "3 finite numbers per line"),
        ("Robot1_Odometry.dat", " 9.0 nan 0.0\n", "finite"),
        ("Robot1_Odometry.dat", " 9.0 x 0.0\n", "expected 3 numbers"),
        ("Robot1_Odometry.dat", " 9.0 0 0\n 8.0 0 0\n", "go back in time at row 1"),
        ("Robot1_Measurement.dat", None, "no such file"),
        ("Robot1_Measurement.dat", " 10.0 63 2.0 0.1\n 11.0 63 3.0 12.0\n", "row 2 .*expected rad"),
        ("Barcodes.dat", " 1 5\n 6 63\n 7 63\n", "barcode 63 is listed 2 times"),
        ("Barcodes.dat", " 1 5\n 6 1e30\n", r"barcode 1e\+30 in row 2; expected whole numbers"),
        ("Barcodes.dat", " 1 5.5\n 6 63\n", "barcode 5.5 in row 1; expected whole numbers"),
    ],
)
def test_an_unreadable_file_is_refused_with_its_reason(folder, name, text, match):
    if text is None:
        (folder / name).unlink()
    else:
        (folder / name).write_text(text)
    with pytest.raises(RecordingError, match=match):
        mrclam.read_robot(folder, 1)


def test_two_places_of_one_number_are_refused(folder, tmp_path):
    (folder / "Landmark_Groundtruth.dat").write_text(" 6 0.5 -4 0 0\n 7 1 1 0 0\n 6 3 2 0 0\n")
    with pytest.raises(RecordingError, match="landmark 6 is listed 2 times"):
        mrclam.read_landmarks(folder)
    tables = {
        "DR": np.array([[0.0, 0.0, 0.0], [1.0, 0.1, 0.0]]),
        "TD": np.array([[0.5, 0.0, 9.0, 2.0]]),
        "TL": np.array([[9.0, 0.0, 1.0], [9.0, 4.0, 1.0]]),
    }
    savemat(tmp_path / "log.mat", tables)
    with pytest.raises(RecordingError, match="table TL: beacon 9 is listed 2 times"):
        read_plaza(tmp_path / "log.mat")


@pytest.mark.parametrize("turned", [0.0, np.pi])
@pytest.mark.parametrize("forward", [1.0, -1.0])
def test_headings_of_the_truth_are_those_of_the_front(tmp_path, turned, forward):
    heading = np.linspace(0.3, 2.0, 40)
    step = forward * 0.1 * np.column_stack([np.cos(heading), np.sin(heading)])
    place = np.cumsum(step, axis=0)
    stamps = np.arange(40.0)
    tables = {
        "DR": np.column_stack([stamps, np.full(40, forward * 0.1), np.zeros(40)]),
        "TD": np.array([[0.5, 0.0, 9.0, 2.0]]),
        "TL": np.array([[9.0, 0.0, 1.0]]),
        "GT": np.column_stack([stamps, place, heading + turned]),
    }
    savemat(tmp_path / "log.mat", tables)
    off = read_plaza(tmp_path / "log.mat").truth[:, 3] - heading
    np.testing.assert_allclose(np.cos(off), 1.0)


def test_the_real_mower_of_plaza2_drives_ahead():
    truth = read_plaza(Path(gtsam.findExampleDataFile("Plaza2_.mat"))).truth
    way = np.diff(truth[:, 1:3], axis=0)
    moves = np.hypot(*way.T) > 0.03
    off = np.arctan2(way[:, 1], way[:, 0]) - truth[:-1, 3]
    assert np.median(np.abs(np.angle(np.exp(1j * off[moves])))) < np.radians(5.0)


def test_the_real_robots_measured_landmarks_and_each_other(recordings):
    folder = recordings / "mrclam6"
    log = mrclam.read_robot(folder, 3)
    assert np.sum(log.subjects > 5) == 4348  # counted by the set's own description
    assert np.sum((log.subjects >= 1) & (log.subjects <= 5)) == 1277
    assert set(mrclam.read_landmarks(folder)) == set(range(6, 21))


def test_the_ranges_of_the_mower_are_seven_per_cent_too_long(recordings):
    log = read_plaza(recordings / "plaza1_range" / "Plaza1_.mat")
    there = np.stack([np.interp(log.stamps_s, log.truth[:, 0], log.truth[:, c]) for c in (1, 2)], 1)
    true = np.linalg.norm(there - log.places[log.beacons], axis=1)
    assert np.median(log.ranges_m / true) == pytest.approx(1.07, abs=0.02)
    assert np.all(np.diff(log.stamps_s) >= 0.0)


def test_a_file_of_another_format_is_refused_as_plaza(tmp_path):
    (tmp_path / "x.mat").write_text("nothing")
    for name in ("x.mat", "absent.mat"):
        with pytest.raises(RecordingError, match="expected a MATLAB file"):
            read_plaza(tmp_path / name)
