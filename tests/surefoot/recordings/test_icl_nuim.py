"""ICL-NUIM: a left-handed world with a negative fy, read as a right-handed one."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from perception.primitives.errors import RecordingError
from surefoot.recordings.open import open_recording

FX, FY, CX, CY = 481.2, -480.0, 319.5, 239.5  # as the set's page has them


def write_set(path, poses, floor_y=-1.2):
    """Rendered by the set's own rules: points ((u - cx) z / fx, (v - cy) z / fy, z), world y up."""
    for folder in ("depth", "rgb"):
        (path / folder).mkdir()
    v, u = np.mgrid[0:480, 0:640]
    ray = np.stack([(u - CX) / FX, (v - CY) / FY, np.ones_like(u, float)], -1)
    lines, truth = [], []
    for number, (rotation, place) in enumerate(poses):
        down = ray @ rotation.as_matrix().T[:, 1]
        with np.errstate(divide="ignore"):
            z = (floor_y - place[1]) / down
        units = np.where((z > 0) & (z < 8), z * 5000, 0)
        cv2.imwrite(str(path / f"depth/{number}.png"), np.rint(units).astype(np.uint16))
        cv2.imwrite(str(path / f"rgb/{number}.png"), np.full((480, 640, 3), 90, np.uint8))
        lines.append(f"{number} depth/{number}.png {number} rgb/{number}.png")
        words = [number, *place, *rotation.as_quat()]
        truth.append(" ".join(str(float(w)) for w in words))
    (path / "associations.txt").write_text("\n".join(lines))
    (path / "livingRoom0.gt.freiburg").write_text("\n".join(truth))


@pytest.fixture
def folder(tmp_path):
    # Left-handed, y up, z ahead: a positive turn about x looks down.
    tilt = [Rotation.from_euler("yx", [0.3 * i, 0.5]) for i in range(3)]
    write_set(tmp_path, [(turn, (0.2 * i, 0.1, 0.5 * i)) for i, turn in enumerate(tilt)])
    return tmp_path


def test_the_floor_is_one_plane_in_the_world_with_the_right_vertical_axis(folder):
    recording = open_recording(folder)
    assert recording.info.kind == "icl_nuim"
    up = np.array(recording.info.gravity_up_world)
    for frame in recording.frames():
        x, y = frame.depth.camera.slopes
        z = frame.depth.depth.astype(float)
        seen = np.isfinite(z)
        assert seen.mean() > 0.4
        points = np.stack([x * z, y * z, z], -1)[seen]
        heights = frame.T_world_camera.apply(points) @ up
        np.testing.assert_allclose(heights, -1.2, atol=2e-3)
        assert frame.T_world_camera.position @ up == pytest.approx(0.1)
        assert np.linalg.det(frame.T_world_camera.rotation) == pytest.approx(1.0)


def test_an_invalid_line_of_pairs_is_named(folder):
    (folder / "associations.txt").write_text("0 depth/0.png 0 rgb/0.png\n1 depth/1.png\n")
    with pytest.raises(RecordingError, match="line 2"):
        open_recording(folder)


@pytest.mark.parametrize("stamp", ["9" * 400, "nan"])
def test_a_pose_without_a_finite_stamp_is_of_no_frame(folder, stamp):
    poses = next(folder.glob("*.gt.freiburg"))
    first, second, *rest = poses.read_text().splitlines()
    second = " ".join([stamp, *second.split()[1:]])
    poses.write_text("\n".join([first, second, *rest]))
    recording = open_recording(folder)
    frames = list(recording.frames())
    assert [frame.T_world_camera is not None for frame in frames] == [True, False, True]
    assert any("1 of 3 frames" in remark for remark in recording.remarks)


def test_frames_beyond_the_trajectory_have_no_pose_and_are_remarked(folder):
    truth = folder / "livingRoom0.gt.freiburg"
    truth.write_text("\n".join(truth.read_text().splitlines()[:2]))
    recording = open_recording(folder)
    frames = list(recording.frames())
    assert [frame.T_world_camera is not None for frame in frames] == [True, True, False]
    assert any("1 of 3 frames" in remark for remark in recording.remarks)
