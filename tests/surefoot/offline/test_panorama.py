"""A panorama from a recording: views placed by camera poses, and by their pictures alone."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pytest

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
from surefoot.offline.panorama import run_panorama
from surefoot.recordings.recording import RecordingInfo

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
    scene, by_pictures, tmp_path
):
    out = tmp_path / "run"
    content = run_panorama(job(Carried(scene), out, by_pictures=by_pictures), quiet)
    assert content["floor_seen"]
    assert all(view["placed"] for view in content["views"])
    (low_right, low_left), (high_right, high_left) = edges(scene, "low"), edges(scene, "high")
    # base: on the floor below the first camera, turned as it was, or as all are in the mean
    base = Pose2(0.6, 1.5, math.radians(36.0) if by_pictures else 0.0)
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


def test_a_frame_becomes_a_view_when_the_camera_has_turned_or_moved(scene, tmp_path):
    content = run_panorama(job(Carried(scene), tmp_path / "a", turn_deg=20.0, step_m=9.0), quiet)
    assert [view["frame"] for view in content["views"]] == [0, 4, 8, 12]  # 6 deg a frame
    content = run_panorama(job(Carried(scene), tmp_path / "b", radius_m=0.1), quiet)
    assert content["left_out"] > 0
    assert max(view["frame"] for view in content["views"]) <= 5  # 2 cm a frame


def test_a_recording_without_valid_depth_is_refused(scene, tmp_path):
    with pytest.raises(RecordingError, match="carried: none of its frames"):
        run_panorama(job(Carried(scene, nothing=True), tmp_path / "run"), quiet)
