"""Poses of recording.toml in every form: the same three poses, written independently of the reader."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from perception.primitives.errors import RecordingError
from surefoot.recordings.open import open_recording

PLACES = [(0.1 * k, -0.2, 1.0 + 0.3 * k) for k in range(3)]
TURNS = Rotation.from_euler("zyx", [(0.2 * k, -0.4, 1.9) for k in range(3)])


def matrices():
    found = np.tile(np.eye(4), (3, 1, 1))
    found[:, :3, :3], found[:, :3, 3] = TURNS.as_matrix(), PLACES
    return found


def line(values):
    return " ".join(f"{value:.17g}" for value in values) + "\n"


def sevens():
    return [line([*place, *quat]) for place, quat in zip(PLACES, TURNS.as_quat(), strict=True)]


def kitti():
    return [line(one[:3].ravel()) for one in matrices()]


def replica():
    return [line(one.ravel()) for one in matrices()]


def describe(path, poses):
    with (path / "recording.toml").open("a") as file:
        file.write(f"[poses]\n{poses}\n")


def with_file(path, lines, poses='file = "traj.txt"'):
    (path / "traj.txt").write_text("".join(lines))
    describe(path, poses)
    return path


def with_folder(path, names, poses='folder = "pose"'):
    (path / "pose").mkdir()
    for name, matrix in zip(names, matrices(), strict=True):
        np.savetxt(path / "pose" / name, matrix)
    describe(path, poses)
    return path


def checked(path, inverse=False):
    recording = open_recording(path)
    frames = list(recording.frames())
    assert recording.info.poses_given
    assert recording.remarks == recording.skipped == []
    for frame, expected in zip(frames, matrices(), strict=True):
        expected = np.linalg.inv(expected) if inverse else expected
        pose = frame.T_world_camera
        np.testing.assert_allclose(pose.position, expected[:3, 3], atol=1e-12)
        np.testing.assert_allclose(pose.rotation, expected[:3, :3], atol=1e-12)


@pytest.mark.parametrize("lines", [sevens, kitti, replica])
def test_the_count_of_numbers_tells_what_a_line_is(plain, lines):
    checked(with_file(plain, lines()))


@pytest.mark.parametrize("lines", [sevens, kitti, replica])
def test_commas_are_blanks(plain, lines):
    checked(with_file(plain, [one.replace(" ", ",") for one in lines()]))


def test_poses_may_be_of_the_world_in_the_camera(plain):
    poses = 'file = "traj.txt"\nconvention = "world-to-camera"'
    checked(with_file(plain, replica(), poses), inverse=True)


def test_lines_without_stamps_go_with_images_that_have_stamps(plain):
    toml = plain / "recording.toml"
    toml.write_text(toml.read_text().replace("rate_hz = 10.0", 'stamps = "times.txt"'))
    (plain / "times.txt").write_text("5.0\n5.2\n5.4\n")
    checked(with_file(plain, kitti()))


def test_of_a_thinned_folder_the_numbers_in_the_names_are_those_of_the_lines(plain):
    for old, new in ((2, 40), (1, 20)):
        for folder in ("depth", "color"):
            (plain / folder / f"{old}.png").rename(plain / folder / f"{new}.png")
    lines = [line(np.eye(4).ravel())] * 50
    for number, one in zip((0, 20, 40), replica(), strict=True):
        lines[number] = one
    checked(with_file(plain, lines))


@pytest.mark.parametrize("names", [["0.txt", "1.txt", "2.txt"], ["a7.txt", "a8.txt", "a9.txt"]])
def test_a_folder_of_matrices_is_paired_by_number_or_order(plain, names):
    checked(with_folder(plain, names))


def test_files_of_poses_are_sorted_by_number(plain):
    checked(
        with_folder(
            plain, ["p8.pose", "p9.pose", "p10.pose"], 'folder = "pose"\npattern = "*.pose"'
        )
    )


@pytest.mark.parametrize("number", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("form", ["tx", "kitti", "matrix", "tum", "folder", "stamps"])
def test_a_pose_that_is_not_finite_is_none_and_its_frame_is_named(plain, form, number):
    """By time, the frame is between two poses that are too far apart to interpolate."""
    lines = {"tx": sevens, "kitti": kitti, "matrix": replica}.get(form, sevens)()
    lines[1] = line([number] * len(lines[1].split()))
    if form == "folder":
        with_folder(plain, ["0.txt", "1.txt", "2.txt"])
        np.savetxt(plain / "pose/1.txt", np.full((4, 4), number))
    elif form in ("tum", "stamps"):
        with_file(plain, [f"{5.0 + 0.2 * k:.1f} {one}" for k, one in enumerate(lines)])
    else:
        with_file(plain, lines)
    if form == "stamps":
        toml = plain / "recording.toml"
        toml.write_text(toml.read_text().replace("rate_hz = 10.0", 'stamps = "times.txt"'))
        (plain / "times.txt").write_text("5.0\n5.2\n5.4\n")
    recording = open_recording(plain)
    frames = list(recording.frames())
    assert [frame.T_world_camera is None for frame in frames] == [False, True, False]
    assert recording.skipped == []
    (remark,) = recording.remarks
    by_time = "1 of 3 depth images have no pose within 0.02 s"
    by_line = "1 frame without pose: it is not finite (first: 1.png)"
    assert remark == (by_time if form == "stamps" else by_line)


def test_replica_reads_lines_as_the_description_does(replica):
    rows = [line(np.eye(4).ravel()), line([-np.inf] * 16)]
    (replica / "traj.txt").write_text("".join(rows))
    recording = open_recording(replica)
    assert [frame.T_world_camera is None for frame in recording.frames()] == [False, True]
    assert "1 frame without pose" in recording.remarks[0]


COUNTS = (
    "7: tx ty tz qx qy qz qw; 8: timestamp tx ty tz qx qy qz qw; 12: the first three rows of a 4x4 matrix, as KITTI has "
    "them; 16: a 4x4 matrix, row by row"
)


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (["# nine\n", line(range(9))], f"traj.txt, line 2: 9 numbers; expected {COUNTS}"),
        ([line(range(4))] * 4, "traj.txt, line 1: 4 numbers; expected 7: tx"),
        ([*replica()[:2], kitti()[2]], "traj.txt, line 3: 12 numbers, expected 16: a 4x4 matrix, row by row"),
        ([*kitti()[:1], *sevens()[1:]], "traj.txt, line 2: 7 numbers, expected 12: the first three rows"),
        ([*sevens()[:2], "9 " + sevens()[2]], "traj.txt, line 3: 8 numbers, expected 7: tx ty tz qx qy qz qw"),
        (["tx ty tz qx qy qz qw\n", *sevens()], "traj.txt, line 1: 'tx' is not a number; expected tx ty tz"),
        (replica()[:2], "traj.txt: 2 poses for 3 images, none for 2.png; one line per image was expected"),
    ],
)  # fmt: skip
def test_lines_that_are_no_poses_are_refused_by_file_line_and_count(plain, lines, message):
    with_file(plain, lines)
    with pytest.raises(RecordingError) as caught:
        open_recording(plain)
    assert message in str(caught.value)


def test_a_matrix_written_column_by_column_is_refused(plain):
    recording = open_recording(with_file(plain, [line(one.T.ravel()) for one in matrices()]))
    with pytest.raises(RecordingError, match="its last row is not 0 0 0 1"):
        list(recording.frames())


@pytest.mark.parametrize(
    ("poses", "message"),
    [
        ('folder = "nowhere"', r"nowhere: no file matches '\*.txt'; check \[poses\] in .*recording.toml"),
        ('folder = "pose"\npattern = "*.mat"', r"pose: no file matches '\*.mat'"),
        ('folder = "pose"\nfile = "traj.txt"', "needs file = .* or folder = .*; one of the two"),
        ('convention = "camera-to-world"', "needs file = .* or folder = .*; one of the two"),
        ('folder = "pose"\npattern = "../*"', "poses.pattern = .* must be below its folder"),
        ('folder = 3', "poses.folder = 3 must be a text in quotes"),
    ],
)  # fmt: skip
def test_a_folder_of_poses_that_is_none_is_refused(plain, poses, message):
    with_folder(plain, ["0.txt", "1.txt", "2.txt"], poses)
    with pytest.raises(RecordingError, match=message):
        open_recording(plain)
