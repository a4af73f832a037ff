"""Invalid intrinsics, descriptions and point clouds are refused by file, key and value."""

import shutil

import numpy as np
import pytest

from perception.primitives.errors import RecordingError
from surefoot.recordings.open import open_recording


def edit(path, old, new):
    text = path.read_text()
    assert old in text, f"{old!r} is not in {path}"
    path.write_text(text.replace(old, new))


# Intrinsics


def test_an_unknown_tum_camera_is_refused(tum, tmp_path):
    (tum / "recording.toml").unlink()
    shutil.move(tum, tmp_path / "mine")
    with pytest.raises(
        RecordingError,
        match=r"neither the folder name nor depth.txt has a TUM camera .*\n\[camera\]\nwidth = 640",
    ):
        open_recording(tmp_path / "mine")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("fx = 14.0", "fx = 0.0", "recording.toml: camera: fx=0.0 px must be positive and finite"),
        ("fx = 14.0", "fx = -480.0", "camera: fx=-480.0 px must be positive"),
        ("fx = 14.0", "fx = 0.8366", "recording.toml: camera: fx=0.8366 px for an image 16 px wide; expected pixels"),
        ("fx = 14.0", "fx = 1e9", "recording.toml: camera: fx=1e.09 px for an image 16 px wide; expected pixels"),
        ("fy = 14.0", "fy = 1e-3", "recording.toml: camera: fy=0.001 px .* not metres or a share of the width"),
        ("rate_hz", "scale_checked = 1\nrate_hz", "scale_checked = 1 must be true or false"),
        ("rate_hz", "calibrated = \"yes\"\nrate_hz", "calibrated = 'yes' must be true or false"),
        ("[depth]", '[poses]\nfile = "p"\naxes = "t265"\n[depth]', "poses.axes = 't265'; expected one of optical, y-up"),
        ("none =", 'encoding = "turned"\nnone =', "depth encoding 'turned' is unknown; expected one of depth, rot"),
        ("cx = 7.5", "cx = 7500", "camera: cx=7500.0 px lies far outside the image of 16 px"),
        ("width = 16", "width = 0", "camera: image 0x12 px must be at least 1x1"),
        ("width = 16", "width = 16.5", r"camera.width = 16.5 must be whole"),
        ("fx = 14.0", "fx = inf", "camera.fx = inf must be a finite number"),
        ("fx = 14.0", 'fx = "14"', "camera.fx = '14' must be a finite number"),
        ("fx = 14.0\n", "", "camera.fx is missing; a number in px"),
        ("cy = 5.5", "cy = 5.5\ndistortion = [0.1]", r"camera.distortion = \[0.1\] must be a list of 5"),
        ("fx = 14.0", "focal = 14.0", "unknown key camera.focal; known keys: width, height, fx"),
        ("rate_hz", "rate_hertz", r"unknown key rate_hertz; did you mean rate_hz\?"),
        ("[camera]", "[camra]", r"unknown key camra; did you mean camera\?"),
        ("scale_per_metre", "scale_per_meter", r"unknown key depth.scale_per_meter; did you mean scale_per_metre\?"),
        ("scale_per_metre = 1000", "scale_per_metre = 0", r"\[depth\] depth scale 0.0 units per metre must be positive"),
        ("scale_per_metre = 1000\n", "", "depth.scale_per_metre is missing; 1000 for millimetres"),
        ("none = [0, 65535]\n", "", r"depth.none is missing; the values of pixels without depth, such as \[0\]"),
        ("none = [0, 65535]", "none = [-1]", "no-depth value -1 must lie between 0 and 65535"),
        ("none = [0, 65535]", 'none = ["0"]', "depth.none holds '0'; numbers were expected"),
        ("none = [0, 65535]", "none = 0", "depth.none = 0 must be a list of numbers"),
        ("rate_hz = 10.0", "rate_hz = -1", "rate_hz = -1.0 must be positive"),
        ("rate_hz = 10.0", "rate_hz = 10.0 fps", "recording.toml: is not valid TOML: .*line 1"),
        ("rate_hz = 10.0", 'stamps = "times.txt"', "times.txt: cannot be read: No such file"),
        ("rate_hz = 10.0", "rate_hz = 10.0\ncolour = 3", r"colour = 3 must be a table \[colour\]"),
        ("[depth]", '[depth]\npattern = "/abs*"', "depth.pattern = '/abs.' must be below its folder"),
        ("[depth]", '[depth]\npattern = "../*.png"', "depth.pattern = .* must be below its folder"),
        ("none = [0, 65535]", "none = [nan]", "depth.none holds nan; numbers were expected"),
        ("[depth]", '[depth]\nfolder = "raw"', "raw: no image matches .*; check .depth. folder and pattern"),
        ("[depth]", '[colour]\nfolder = "raw"\n[depth]', r"raw: no image matches .*; check \[colour\]"),
        ("[depth]", '[poses]\nfile = "p.txt"\n[depth]', "p.txt: cannot be read: No such file"),
        ("[depth]", "[poses]\n[depth]", r"\[poses\] needs file = a text file of TUM lines"),
        ("[depth]", '[poses]\nfile = "p"\nconvention = "c2w"\n[depth]', "convention = 'c2w'; expected one of camera-to-world"),
        ("[depth]", "[world]\nup = [0, 0, 0]\n[depth]", r"world.up = \[0.0, 0.0, 0.0\] is not a direction"),
    ],
)  # fmt: skip
def test_an_invalid_description_is_refused_by_key_and_value(plain, old, new, message):
    edit(plain / "recording.toml", old, new)
    with pytest.raises(RecordingError, match=message):
        open_recording(plain)


def test_a_description_without_a_camera_is_refused(plain):
    toml = plain / "recording.toml"
    toml.write_text("rate_hz = 10\n" + toml.read_text()[toml.read_text().index("[depth]") :])
    with pytest.raises(RecordingError, match=r"table \[camera\] is missing; for example"):
        open_recording(plain)


def test_a_missing_description_is_refused(plain, tmp_path):
    with pytest.raises(RecordingError, match=r"nowhere.toml: cannot be read: No such file"):
        open_recording(plain, tmp_path / "nowhere.toml")


def test_a_description_cannot_override_the_layout(redwood):
    (redwood / "recording.toml").write_text("rate_hz = 5\n")
    with pytest.raises(RecordingError, match=r"rate_hz is defined by the layout \(redwood\)"):
        open_recording(redwood)


def test_counts_of_stamps_and_poses_are_compared_with_the_images(plain):
    edit(plain / "recording.toml", "rate_hz = 10.0", 'stamps = "times.txt"')
    (plain / "times.txt").write_text("1.0\n2.0\n")
    with pytest.raises(
        RecordingError, match=r"times.txt: 2 stamps for 3 depth images; one per image"
    ):
        open_recording(plain)


def test_file_names_without_stamps_are_refused(plain):
    edit(plain / "recording.toml", "rate_hz = 10.0", 'stamps = "name"')
    shutil.move(plain / "depth/1.png", plain / "depth/x1.png")
    with pytest.raises(RecordingError, match=r"stamps = .name., but 'x1' is not a time in s"):
        open_recording(plain)


def test_poses_of_another_clock_are_refused(plain):
    edit(plain / "recording.toml", "rate_hz = 10.0", 'stamps = "times.txt"')
    edit(plain / "recording.toml", "[depth]", '[poses]\nfile = "p.txt"\n[depth]')
    (plain / "times.txt").write_text("1.0\n2.0\n3.0\n")
    (plain / "p.txt").write_text("1700000000.0 0 0 0 0 0 0 1\n")
    with pytest.raises(RecordingError, match=r"no pose within 0.02 s of any frame: .* one clock"):
        open_recording(plain)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ('{"intrinsic_matrix": [1, 2], "width": 16, "height": 12}', "has 2 numbers, 9 were expected"),
        ('{"intrinsic_matrix": [1, 2]', "cannot be read as intrinsics of Open3D or RealSense"),
        ('{"intrinsic_matrix": [0,0,0,0,0,0,0,0,0], "width": 16, "height": 12}', "fx=0.0 px must be positive"),
        ('{"intrinsic_matrix": [1,0,0,0,1,0,1,1,1]}', r"cannot be read as intrinsics of Open3D or RealSense \('width'\)"),
    ],
)  # fmt: skip
def test_invalid_intrinsics_of_open3d_are_refused(redwood, content, message):
    (redwood / "camera_primesense.json").write_text(content)
    with pytest.raises(RecordingError, match=f"camera_primesense.json: .*{message}"):
        open_recording(redwood)


def test_invalid_parameters_of_replica_are_refused(replica):
    edit(replica / "cam_params.json", '"scale": 6553.5', '"scale": 0')
    with pytest.raises(RecordingError, match=r"cam_params.json: cannot be read \(depth scale 0.0"):
        open_recording(replica)


def test_invalid_intrinsics_and_gravity_of_seven_scenes_are_refused(seven_scenes):
    np.savetxt(seven_scenes.parent / "gravity-direction.txt", [0.0, 0.0, 0.0])
    with pytest.raises(RecordingError, match=r"gravity-direction.txt: gravity has length 0;"):
        open_recording(seven_scenes)
    np.savetxt(seven_scenes.parent / "camera-intrinsics.txt", np.zeros((3, 3)))
    with pytest.raises(RecordingError, match=r"camera-intrinsics.txt: camera: fx=0.0 px"):
        open_recording(seven_scenes)
    np.savetxt(seven_scenes.parent / "camera-intrinsics.txt", np.eye(2))
    with pytest.raises(RecordingError, match=r"camera-intrinsics.txt: 2 rows; a 3x3 matrix"):
        open_recording(seven_scenes)


# Clouds


def _replace(old, new):
    return lambda content: content.replace(old, new)


@pytest.mark.parametrize(
    ("data", "spoil", "message"),
    [
        ("binary", lambda c: b"", "the file is empty"),
        ("binary", lambda c: b"ply\n" + b"x" * 9000, "is not a PCD file: its header has no line DATA"),
        ("binary", lambda c: c[:-7], "is truncated: 2297 of 2304 bytes of points"),
        ("binary_compressed", lambda c: c[:-7], "is truncated: .* bytes of points"),
        ("binary_compressed", lambda c: c[:-7] + b"\xff" * 7, "its compressed points are damaged"),
        ("binary_compressed", _replace(b"WIDTH 16", b"WIDTH 15"), "unpacks to 2304 bytes; 180 points of 12"),
        ("ascii", lambda c: c[: c.rindex(b"\n", 0, -1)], "is truncated: 191 of 192 points"),
        ("ascii", lambda c: c[:-4] + b"abc\n", "a point cannot be parsed"),
        ("binary", _replace(b"WIDTH 16\nHEIGHT 12", b"WIDTH 192\nHEIGHT 1"), "192x1 is not organised"),
        ("binary", _replace(b"WIDTH 16\nHEIGHT 12", b"WIDTH 12\nHEIGHT 16"), "no pinhole camera fits"),
        ("binary", _replace(b"WIDTH 16", b"WIDTH many"), "WIDTH many in its header is not a number"),
        ("binary", _replace(b"FIELDS x y z", b"FIELDS x y w"), "has no field z; x, y and z"),
        ("binary", _replace(b"SIZE 4 4 4", b"SIZE 4 4"), "FIELDS, SIZE, TYPE and COUNT do not agree"),
        ("binary", _replace(b"DATA binary", b"DATA zip"), "DATA 'zip'; ascii, binary or"),
        ("binary", _replace(b"TYPE F F F\n", b""), "its header has no line TYPE"),
        ("binary", lambda c: c[:-2304] + b"\xff" * 2304, "0 points in front of the camera; at least 100"),
    ],
)  # fmt: skip
def test_a_point_cloud_without_a_depth_image_is_refused(pcd, data, spoil, message):
    path = pcd(data)
    path.write_bytes(spoil(path.read_bytes()))
    with pytest.raises(RecordingError, match=message):
        open_recording(path)
