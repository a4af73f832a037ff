"""EuRoC folders and calibrations of stereo rigs: real ones, and errors of invalid ones."""

from __future__ import annotations

import shutil

import cv2
import numpy as np
import pytest

from perception.primitives.errors import RecordingError
from perception.primitives.pose import CAMERA_IN_BODY_AXES
from surefoot.recordings.euroc import is_euroc, open_euroc
from surefoot.recordings.recording import Recording
from surefoot.recordings.stereo_calibration import (
    read_euroc_camera,
    read_extrinsics,
    read_rectified_pair,
)


@pytest.fixture
def rig(tmp_path, recordings):
    """A writable copy: calibrations and two small pairs, the second right image missing."""
    source = recordings / "euroc_v101_stereo"
    for name in ("cam0", "cam1"):
        shutil.copyfile(source / f"{name}.yaml", tmp_path / f"{name}.yaml")
        (tmp_path / name).mkdir()
    for path in sorted((source / "static" / "cam0").glob("*.png"))[:2]:
        cv2.imwrite(str(tmp_path / "cam0" / path.name), cv2.imread(str(path)))
    first = min((source / "static" / "cam1").glob("*.png"))
    cv2.imwrite(str(tmp_path / "cam1" / first.name), cv2.imread(str(first)))
    return tmp_path


def test_a_camera_at_rest_measures_gravity_along_the_floor_normal(recordings):
    recording = open_euroc(recordings / "euroc_v101_stereo" / "static")
    assert isinstance(recording, Recording)
    frames = list(recording.frames())
    assert len(frames) == recording.info.frames == 7
    # the clock of the recording, so that its ground truth can be matched
    assert frames[0].stamp_s == pytest.approx(1403715273.262142976, abs=1e-6)
    assert frames[1].stamp_s - frames[0].stamp_s == pytest.approx(0.75, abs=1e-6)
    assert frames[0].stereo.baseline_m == pytest.approx(0.11008, abs=1e-5)
    assert frames[0].stereo.camera.fx == pytest.approx(436.244, abs=1e-2)
    normal = recording.rig.T_left_rectified.inverse().rotation @ [0.035552, -0.927543, -0.372020]
    up = CAMERA_IN_BODY_AXES.T @ frames[0].imu.specific_force
    cosine = normal @ up / np.linalg.norm(up)
    assert np.degrees(np.arccos(cosine)) < 1.0  # floor.csv has the accelerometer's direction
    assert all(frame.T_world_camera is None for frame in frames)


def test_the_given_poses_place_the_rectified_camera_above_the_floor(recordings):
    recording = open_euroc(recordings / "euroc_v101_stereo" / "room")
    assert recording.info.poses_given
    heights = [frame.T_world_camera.translation[2] for frame in recording.frames()]
    np.testing.assert_allclose(heights, [1.566570, 1.721729], atol=1e-3)  # floor.csv


def test_an_unmatched_image_is_remarked_and_left_out(rig):
    assert is_euroc(rig)
    recording = open_euroc(rig)
    assert len(list(recording.frames())) == 1
    assert any("1 left images have no right image" in remark for remark in recording.remarks)
    assert any("no imu0 file" in remark for remark in recording.remarks)


def test_names_that_are_no_stamps_in_ns_are_refused(rig):
    for camera in ("cam0", "cam1"):
        for old in (rig / camera).glob("*.png"):
            old.rename(rig / "kept.png")
        for number in range(3):
            shutil.copyfile(rig / "kept.png", rig / camera / f"{number:06}.png")
    with pytest.raises(RecordingError, match=r"1e-09 s apart.*EuRoC are read as ns, .*numbers"):
        list(open_euroc(rig).frames())


def test_a_damaged_image_is_skipped(rig):
    image = min((rig / "cam1").glob("*.png"))
    image.write_bytes(image.read_bytes()[:2000])
    recording = open_euroc(rig)
    with pytest.raises(RecordingError, match="no frame can be used"):
        list(recording.frames())
    assert len(recording.skipped) == 1


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("pinhole", "omni", "camera_model is 'omni'"),
        ("radial-tangential", "equidistant", "distortion_model is 'equidistant'"),
        ("intrinsics: [458.654,", "intrinsics: [", "intrinsics has 3 numbers"),
        ("T_BS:", "T_SB:", "has no list T_BS"),
        ("0.999557249008", "0.5", "T_BS has no valid rotation"),
    ],
)
def test_an_invalid_calibration_is_refused_with_its_reason(rig, old, new, message):
    path = rig / "cam0.yaml"
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(RecordingError, match=message):
        open_euroc(rig)


def test_exchanged_cameras_are_refused(rig):
    one, other = rig / "cam0.yaml", rig / "cam1.yaml"
    left, right = one.read_text(), other.read_text()
    one.write_text(right)
    other.write_text(left)
    with pytest.raises(RecordingError, match="must be to its right"):
        open_euroc(rig)


def test_a_rectified_pairs_calibration_gives_camera_and_baseline(recordings):
    folder = recordings / "rtabmap_3it"
    camera, baseline = read_rectified_pair(
        folder / "stereo_left.yaml", folder / "stereo_right.yaml"
    )
    assert (camera.width, camera.height) == (640, 480)
    assert camera.fx == pytest.approx(487.609, abs=1e-3)
    assert baseline == pytest.approx(0.11969, abs=1e-5)
    with pytest.raises(RecordingError, match="may be exchanged"):
        read_rectified_pair(folder / "stereo_right.yaml", folder / "stereo_left.yaml")


def test_cameras_and_imu_share_one_format_of_extrinsics(recordings):
    folder = recordings / "euroc_v101_stereo"
    assert np.allclose(read_extrinsics(folder / "imu0.yaml").matrix, np.eye(4))
    raw = read_euroc_camera(folder / "cam0.yaml")
    assert raw.camera.distortion[0] == -0.28340811
