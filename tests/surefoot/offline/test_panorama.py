"""A panorama from a recording: views placed by camera poses, and by their pictures alone."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mapping.io import clouds
from mapping.panorama.view_selection import ViewSelectionConfig
from perception.primitives.camera import Camera
from perception.primitives.errors import RecordingError
from perception.primitives.frame import ColourView, DepthView, Frame
from perception.primitives.pose import Pose2, Pose3, head_rotation
from sim.scenes import catalogue
from sim.shapes import outline
from sim.world import World
from surefoot.config.schema import Config
from surefoot.experiments.seed_003.stereo_range import true_depth
from surefoot.offline.job import Job
from surefoot.offline.panorama import panorama_lines, run_panorama
from surefoot.recordings.recording import RecordingInfo
from surefoot.results.moments import read_moments
from surefoot.results.run_folder import RunFolder

from ..report.browser import CHROMIUM, Browser
from ..report.replaying import moved

CAMERA = Camera.from_view(200, 150, math.radians(60.0), math.radians(46.8))


class Carried:
    """A depth camera that turns from left to right while it is carried 24 cm ahead; every frame has its pose."""

    def __init__(self, scene, nothing=False):
        self.info = RecordingInfo(
            "carried",
            "plain",
            poses_given=True,
            gravity_up_world=(0.0, 0.0, 1.0),
            floor_height_world_m=0.0,
        )
        self.skipped, self.remarks = [], []
        self._seen = []
        with World(scene, "tiny") as world:
            for k, degrees in enumerate(np.arange(36.0, -37.0, -6.0)):
                body = Pose2(0.6 + 0.02 * k, 1.5, math.radians(degrees)).lifted()
                head = Pose3.from_rotation(head_rotation(0.0, 0.3), np.array([0.0, 0.0, 0.4]))
                pose = body @ head
                depth = true_depth(world, CAMERA, pose).astype(np.float32)
                picture = world.picture(CAMERA, pose)
                self._seen.append(
                    (pose, np.full_like(depth, np.nan) if nothing else depth, picture)
                )

    def frames(self):
        for k, (pose, depth, picture) in enumerate(self._seen):
            colour = ColourView(picture, CAMERA, None)
            yield Frame(0.1 * k, depth=DepthView(depth, CAMERA), colour=colour, T_world_camera=pose)


@pytest.fixture(scope="module")
def scene():
    return catalogue.load("boxes", 0)


@pytest.fixture(scope="module")
def carried(scene):
    return Carried(scene)


def quiet(text):
    pass


def job(recording, out, **selection):
    config = dataclasses.replace(Config(), panorama=ViewSelectionConfig(**selection))
    return Job.of("panorama", recording, config, out)


def edges(scene, name):
    """Least and greatest y of the row of boxes of that name, in truth."""
    y = [outline(p)[:, 1] for t in scene.obstacles if name in t.name for p in t.parts]
    return min(v.min() for v in y), max(v.max() for v in y)


@pytest.mark.parametrize("by_pictures", [False, True])
def test_rows_of_boxes_and_the_gap_between_them_are_found_at_their_true_edges(
    scene, carried, by_pictures, tmp_path
):
    out = tmp_path / "run"
    wanted = job(carried, out, by_pictures=by_pictures, turn_deg=11.0)  # 6 deg a frame
    content = run_panorama(wanted, quiet)
    assert content["floor_seen"]
    assert all(view["placed"] for view in content["views"])
    (low_right, low_left), (high_right, high_left) = edges(scene, "low"), edges(scene, "high")
    base = Pose2(
        0.6, 1.5, 0.0
    )  # on the floor below the first camera, turned as all are in the mean
    found = [
        base.apply(np.array([one["left_edge_m"], one["right_edge_m"]]))[:, 1]
        for one in content["obstacles"]
    ]
    rows = [pair for pair in found if pair.min() > 0.3 and pair.max() < 2.9]
    for right, left in ((high_right, high_left), (low_right, low_left)):
        best = min(rows, key=lambda pair: np.abs(np.sort(pair) - (right, left)).sum())
        np.testing.assert_allclose(np.sort(best), (right, left), atol=0.06)
    assert max(one["width_m"] for one in content["obstacles"]) < 4.5  # the room
    assert json.loads((out / "panorama.json").read_text()) == content
    assert (out / "panorama_obstacles.png").stat().st_size > 5000
    points, _ = clouds.load_ply(out / "panorama.ply")
    ranges = np.load(out / "panorama.npz")
    assert len(points) == np.isfinite(ranges["range_m"]).sum() > 10_000
    floor = np.abs(points[:, 2]) < 0.02
    assert 0.2 < floor.mean() < 0.8  # the floor is at height 0, boxes and walls are not


def test_a_frame_becomes_a_view_when_the_camera_has_turned_or_moved(carried, tmp_path, pages):
    with pages():
        content = run_panorama(job(carried, tmp_path / "a", turn_deg=20.0, step_m=9.0), quiet)
    assert [view["frame"] for view in content["views"]] == [0, 4, 8, 12]  # 6 deg a frame
    written = list(
        read_moments(RunFolder(tmp_path / "a"))
    )  # the stream has the views as they were placed
    placed = [view["T_base_camera"] for view in content["views"]]
    found = [one.cameras["depth"].matrix for one in written]
    np.testing.assert_allclose(found, placed, atol=1e-9)
    assert all(one.depth is not None and one.colour is not None for one in written)
    if CHROMIUM is not None:
        with Browser(tmp_path / "profile") as browser:
            for width in (1300, 400):
                panes = " ".join(moved(browser, tmp_path / "a" / "replay.html", width))
                assert all(name in panes for name in ("Top view", "Camera", "Depth"))
    content = run_panorama(job(carried, tmp_path / "b", radius_m=0.1), quiet)
    assert content["left_out"] > 0
    assert max(view["frame"] for view in content["views"]) <= 5  # 2 cm a frame


class Moved(Carried):
    """The same recording with its world turned and shifted, and no word about gravity."""

    def __init__(self, carried, T_new_world):
        self.info = dataclasses.replace(carried.info, gravity_up_world=None)
        self.skipped, self.remarks = [], []
        self._seen = [(T_new_world @ pose, *images) for pose, *images in carried._seen]


class Interrupted(Carried):
    """The same recording, of which all but some frames show a blank wall."""

    def __init__(self, carried, shown):
        self.info, self.skipped, self.remarks = carried.info, [], []
        blank = np.full(carried._seen[0][1].shape, 1.0, np.float32)
        self._seen = [
            one if k in shown else (one[0], blank, np.full_like(one[2], 90))
            for k, one in enumerate(carried._seen)
        ]


def test_the_floor_in_the_pictures_decides_whatever_the_axes_of_the_poses(carried, tmp_path):
    turned = Rotation.random(random_state=5).as_matrix()
    moved = Moved(carried, Pose3.from_rotation(turned, np.array([30.0, -20.0, 9.0])))
    contents = [
        run_panorama(job(one, tmp_path / name, turn_deg=20.0, step_m=9.0), quiet)
        for one, name in ((carried, "as it was"), (moved, "moved"))
    ]
    for content in contents:
        heights = [view["T_base_camera"][2][3] for view in content["views"]]
        np.testing.assert_allclose(heights, 0.40, atol=0.005)  # in truth
        assert abs(content["floor"]["camera_height_m"] - 0.40) < 3.0 * content["floor"]["sigma_m"]
    poses = [np.array([v["T_base_camera"] for v in content["views"]]) for content in contents]
    np.testing.assert_allclose(poses[0], poses[1], atol=0.003)  # the base does not know the axes


def test_a_panorama_of_fewer_than_half_of_its_views_has_failed_and_says_why(carried, tmp_path):
    few = Interrupted(carried, shown=(0, 1, 2, 3))
    content = run_panorama(job(few, tmp_path / "few", by_pictures=True, most_views=7), quiet)
    assert [view["frame"] for view in content["views"] if view["placed"]] == [0, 2]
    assert content["failed"].startswith("only 2 of 7 views")
    assert all("features" in view["reason"] for view in content["views"] if not view["placed"])
    assert any("frame 4 not placed" in line for line in panorama_lines(content))


class Floorless(Carried):
    """The same recording with holes in place of all that is lower than 8 cm."""

    def __init__(self, carried):
        self.info, self.skipped, self.remarks = carried.info, [], []
        self._seen = []
        for pose, depth, picture in carried._seen:
            height = (CAMERA.rays * depth[..., None]) @ pose.rotation[2] + pose.position[2]
            self._seen.append((pose, np.where(height > 0.08, depth, np.nan), picture))


def test_a_panorama_without_a_floor_states_no_sizes_and_says_why(carried, tmp_path):
    content = run_panorama(job(Floorless(carried), tmp_path / "run", turn_deg=11.0), quiet)
    assert all(view["placed"] for view in content["views"])
    assert not content["floor_seen"]
    assert (content["obstacles"], content["gaps"]) == ([], [])
    assert content["failed"].startswith("no floor was found")


def test_one_bad_view_is_no_gap_in_a_panorama_by_pictures(carried, tmp_path):
    most = Interrupted(carried, shown=[k for k in range(13) if k != 6])
    content = run_panorama(job(most, tmp_path / "most", by_pictures=True, most_views=7), quiet)
    assert content["failed"] is None
    assert [view["frame"] for view in content["views"] if not view["placed"]] == [6]


def test_a_recording_without_valid_depth_is_refused(scene, tmp_path):
    with pytest.raises(RecordingError, match="carried: none of its frames has a depth image"):
        run_panorama(job(Carried(scene, nothing=True), tmp_path / "run"), quiet)
