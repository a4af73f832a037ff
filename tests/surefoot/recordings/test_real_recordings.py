"""Real recordings: with correct scale, intrinsics and pose convention, their floors are at known heights."""

import csv
import itertools

import cv2
import numpy as np
import pytest

from surefoot.recordings.codec import encode
from surefoot.recordings.mcap_format import RecordingWriter
from surefoot.recordings.open import open_recording


def points_world(frame):
    """All valid points of a frame in the world of the recording, m."""
    z = frame.depth.depth.astype(np.float64)[..., None]
    points = (frame.depth.camera.rays * z)[np.isfinite(z[..., 0])]
    return frame.T_world_camera.apply(points)


def mode(heights, low, high):
    """Mode of the heights between two limits, in bins of 1 cm, m."""
    counts, edges = np.histogram(heights, np.arange(low, high, 0.01))
    return edges[np.argmax(counts)] + 0.005


def test_the_floor_of_tum_fr3_is_at_height_zero(recordings):
    recording = open_recording(recordings / "tum_fr3_cabinet")
    heights = [mode(points_world(f)[:, 2], -0.5, 0.5) for f in recording.frames()]
    assert len(heights) == 38
    assert recording.skipped == []
    assert abs(np.median(heights)) < 0.02  # its README: fits lie 12 mm off, worst 18


@pytest.mark.parametrize(("part", "count"), [("sweep", 75), ("pan", 40)])
def test_the_floor_of_the_red_kitchen_is_1488_mm_below_the_origin(recordings, part, count):
    recording = open_recording(recordings / "sevenscenes_redkitchen" / part)
    up = np.array(recording.info.gravity_up_world)
    with (recordings / "sevenscenes_redkitchen" / "floor.csv").open() as file:
        known = {
            int(r["frame"]): (float(r["ny"]), float(r["height_m"]))
            for r in csv.DictReader(line for line in file if not line.startswith("#"))
        }
    heights, read = [], 0
    for frame in recording.frames():
        read += 1
        number = round(frame.stamp_s * 30)
        up_camera = frame.T_world_camera.rotation.T @ up
        ny, height_m = known[number]
        assert up_camera[1] == pytest.approx(ny, abs=1e-3)
        camera_height = frame.T_world_camera.position @ up + 1.488
        assert camera_height == pytest.approx(height_m, abs=0.005)
        if number <= 120 or number >= 700:
            heights.append(mode(points_world(frame) @ up, -1.7, -1.3))
    assert read == count
    assert np.median(heights) == pytest.approx(-1.488, abs=0.03)  # fits within 3 cm by its README


def test_the_floor_of_the_redwood_room_is_at_013(recordings):
    recording = open_recording(recordings / "redwood_livingroom")
    assert recording.info.gravity_up_world == (0.0, 1.0, 0.0)
    heights = [mode(points_world(f)[:, 1], -0.3, 0.5) for f in recording.frames()]
    assert len(heights) == 5
    np.testing.assert_allclose(heights, 0.13, atol=0.015)


def test_the_floor_of_the_replica_office_is_at_minus_1135(recordings):
    recording = open_recording(recordings / "replica_office0")
    frames = list(recording.frames())
    assert [f.stamp_s for f in frames] == [0.0, 0.1]
    lowest = min(np.percentile(points_world(f)[:, 2], 0.1) for f in frames)
    assert lowest > -1.16


def test_the_boxes_on_the_low_floor_are_read_in_millimetres(recordings):
    frames = list(open_recording(recordings / "realsense_low_boxes").frames())
    assert len(frames) == 6
    path = recordings / "realsense_low_boxes" / "depth" / "000003.png"
    units = cv2.imread(str(path), cv2.IMREAD_UNCHANGED).astype(float)
    np.testing.assert_allclose(np.nan_to_num(frames[3].depth.depth), units / 1000, rtol=1e-6)
    assert frames[0].depth.camera.fy == 617.5486450195312
    assert frames[0].T_world_camera is None


def test_five_people_agree_with_open3d_point_for_point(recordings):
    open3d = pytest.importorskip("open3d", exc_type=ImportError)
    path = recordings / "pcl_kinect" / "five_people.pcd"
    (frame,) = open_recording(path).frames()
    cloud = open3d.io.read_point_cloud(str(path), remove_nan_points=False)
    expected = np.asarray(cloud.points).reshape(480, 640, 3)
    z = frame.depth.depth.astype(np.float64)
    np.testing.assert_allclose(frame.depth.camera.rays * z[..., None], expected, atol=1e-5)
    camera = frame.depth.camera
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == pytest.approx(
        (525, 525, 319.5, 239.5), abs=1e-4
    )
    colours = np.round(np.asarray(cloud.colors).reshape(480, 640, 3) * 255)
    seen = np.isfinite(z)
    np.testing.assert_array_equal(frame.colour.rgb[seen], colours[seen])


def test_the_unregistered_tunnel_is_read_with_a_description(recordings, tmp_path):
    """Depth 65535 and 0; intrinsics of its infrared camera; the pair is one depth image of 640x480."""
    description = tmp_path / "tunnel.toml"
    description.write_text(
        "[camera]\nwidth = 640\nheight = 480\nfx = 575.93\nfy = 576.41\ncx = 315.15\ncy = 230.59\n"
        '[depth]\nfolder = "."\npattern = "depth_*.png"\nscale_per_metre = 1000\nnone = [0]\n'
    )
    (frame,) = open_recording(recordings / "cape_tunnel", description).frames()
    assert 0.5 < np.nanmedian(frame.depth.depth) < 10.0
    assert frame.colour is None


@pytest.mark.parametrize(
    "name",
    ["tum_fr3_cabinet", "redwood_livingroom", "realsense_low_boxes"],
)
def test_a_copy_in_our_format_has_identical_depth_poses_and_stamps(
    recordings, tmp_path, same, name
):
    original = open_recording(recordings / name)
    frames = list(itertools.islice(original.frames(), 5))
    with RecordingWriter(tmp_path / "recording.mcap", original.info) as writer:
        for frame in frames:
            writer.write(encode(frame))
    copies = list(open_recording(tmp_path).frames())
    assert len(copies) == len(frames)
    for copy, frame in zip(copies, frames, strict=True):
        assert same(copy.depth, frame.depth)
        assert same(copy.T_world_camera, frame.T_world_camera)
        assert same(copy.stamp_s, frame.stamp_s)
        assert np.abs(copy.colour.rgb.astype(int) - frame.colour.rgb).mean() < 4.0
