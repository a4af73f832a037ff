"""The map of a whole recording, compared with what is known of the place."""

from __future__ import annotations

import json
import math
import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy import ndimage

from mapping.io import geotiff
from perception.primitives.camera import Camera
from perception.primitives.errors import InputError, RecordingError
from perception.primitives.frame import ColourView, DepthView, Frame
from perception.primitives.pose import Pose3, head_rotation
from surefoot.config import toml
from surefoot.config.schema import Config
from surefoot.evaluation.evaluate import evaluate
from surefoot.evaluation.metrics.trajectory import trajectory_metrics
from surefoot.offline.job import Job
from surefoot.offline.map import map_recording
from surefoot.recordings.open import open_recording
from surefoot.recordings.recording import RecordingInfo
from surefoot.results.moments import read_moments
from surefoot.results.run_folder import RunFolder
from surefoot.results.tables import read_tum

from ..report.browser import CHROMIUM, Browser
from ..report.replaying import moved

WALK = Path(__file__).parents[3] / "data" / "walk"
CAMERA = Camera(96, 72, 80.0, 80.0, 47.5, 35.5)
DESCRIPTION = """\
stamps = "stamps.txt"
[camera]
width = 640
height = 480
fx = 535.4
fy = 539.2
cx = 320.1
cy = 247.6
[depth]
scale_per_metre = 5000
none = [0]
"""


def quiet(text):
    pass


@pytest.fixture(scope="module")
def cabinet(recordings, tmp_path_factory, pages):
    """A box on a bare floor, its recording without any pose; and the true trajectory."""
    source, folder = recordings / "tum_fr3_cabinet", tmp_path_factory.mktemp("cabinet")
    truth = source / "groundtruth.txt"
    lines = [line for line in truth.read_text().splitlines() if not line.startswith("#")]
    (folder / "stamps.txt").write_text("\n".join(line.split()[0] for line in lines))
    (folder / "recording.toml").write_text(DESCRIPTION)
    for part in ("depth", "rgb"):
        shutil.copytree(source / part, folder / part)
    said = []
    job = Job.open("map", folder, None, Config(), folder / "map")
    with pages():
        mapped = map_recording(job, said.append)
    return mapped, Path(mapped.folder), truth, said


def test_the_trajectory_is_found_without_a_pose(cabinet):
    mapped, folder, truth, _ = cabinet
    figures = trajectory_metrics(read_tum(folder / "trajectory.txt"), read_tum(truth))
    assert figures["matched_poses"] == 38
    assert figures["ate_m"] <= 0.03
    assert mapped.lost == 0


def test_the_floor_is_at_height_zero_and_the_box_stands_on_it(cabinet):
    _, folder, _, _ = cabinet
    layers = np.load(folder / "layers.npz")
    height = layers["elevation"]
    floor = np.abs(height) < 0.05
    assert np.nanmedian(height[floor]) == pytest.approx(0.0, abs=0.01)
    labels, count = ndimage.label((height > 0.45) & (height < 0.65))
    largest = 1 + int(np.argmax(np.bincount(labels.ravel())[1:])) if count else 0
    top = labels == largest
    area = float(top.sum()) * float(layers["resolution"]) ** 2
    assert 0.9 * 0.79 * 0.45 < area < (0.79 + 0.05) * (0.45 + 0.05)  # half a cell more all round
    assert np.nanmedian(height[top]) == pytest.approx(0.554, abs=0.02)


def test_all_files_are_written_and_can_be_opened(cabinet):
    import open3d as o3d

    mapped, folder, _, said = cabinet
    names = {path.name for path in folder.iterdir() if not path.name.startswith(".")}
    assert names >= {
        "trajectory.txt", "graph.g2o", "mesh.ply", "cloud.ply", "map.yaml", "map.pgm", "layers.npz",
        "summary.json", "config.toml", "report.html", "space_covariance.csv",
    }  # fmt: skip
    mesh = o3d.io.read_triangle_mesh(str(folder / "mesh.ply"))
    assert len(mesh.vertices) == mapped.vertices
    assert mesh.has_vertex_colors()
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["frames"] == 38
    assert summary["kind"] == "map"
    assert summary["command"] == f"surefoot map {folder.parent} --config {folder / 'config.toml'}"
    assert toml.read(Config, folder / "config.toml") == Config()
    assert said[0].startswith("trajectory: frame 1 of 38")


def test_the_stream_of_a_map_has_the_cameras_of_its_trajectory_and_a_replay_page(cabinet):
    _, folder, _, _ = cabinet
    moments = list(read_moments(RunFolder(folder)))
    trajectory = read_tum(folder / "trajectory.txt")
    assert [one.stamp_s for one in moments] == pytest.approx(trajectory.stamps.tolist(), abs=1e-5)
    places = [one.cameras["depth"].position for one in moments]
    np.testing.assert_allclose(places, trajectory.positions, atol=1e-4)
    assert sum(one.colour is not None and one.depth is not None for one in moments) == 38
    assert 'href="replay.html"' in (folder / "report.html").read_text()
    assert (folder / "replay.html").stat().st_size < 12e6


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium on the PATH; apt-get install chromium")
def test_its_replay_page_moves_on_any_screen(cabinet, tmp_path):
    with Browser(tmp_path) as browser:
        for width in (1300, 400):
            panes = " ".join(moved(browser, cabinet[1] / "replay.html", width))
            assert all(name in panes for name in ("Top view", "Camera", "Depth"))


def test_a_walk_by_time_of_flight_is_mapped_with_the_poses_of_its_localiser(tmp_path):
    job = Job.open("map", WALK, None, Config(), tmp_path / "map")
    mapped = map_recording(job, quiet)
    assert mapped.frames == 43
    assert mapped.walkable_m2 > 2.0
    metrics = evaluate(RunFolder(tmp_path / "map"))
    assert metrics["ate_m"] < 0.02
    layers = np.load(tmp_path / "map" / "layers.npz")
    floor = np.abs(layers["elevation"]) < 0.05
    assert np.nanmedian(layers["elevation"][floor]) == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize("part", ["room", "static"])
def test_stereo_pairs_are_mapped_with_and_without_poses(recordings, tmp_path, part):
    path = recordings / "euroc_v101_stereo" / part
    mapped = map_recording(Job.open("map", path, None, Config(), tmp_path / "map"), quiet)
    assert mapped.frames == {"room": 2, "static": 7}[part]
    assert mapped.lost == 0
    assert mapped.vertices > 5000


class Held:
    """A camera that is carried over a bare floor; its poses are given in a world whose up is unknown."""

    def __init__(self, depth=True, up=None, T_place_world=None):
        self.info = RecordingInfo("held", "plain", poses_given=True, gravity_up_world=up)
        self.skipped, self.remarks = [], []
        y_down = Pose3.from_rotation(np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), np.zeros(3))
        self._frames = []
        for k in range(3):
            head = Pose3.from_rotation(head_rotation(0.0, 0.7), np.array([0.05 * k, 0.0, 0.8]))
            ray = head.rotation @ np.moveaxis(CAMERA.rays, -1, 0).reshape(3, -1)
            z = (-0.8 / ray[2]).reshape(72, 96).astype(np.float32)
            view = DepthView(np.where(z > 0, z, np.nan), CAMERA) if depth else None
            colour = ColourView(np.full((72, 96, 3), 90, np.uint8), CAMERA)
            pose = (T_place_world or Pose3()) @ y_down @ head
            self._frames.append(Frame(0.1 * k, depth=view, colour=colour, T_world_camera=pose))

    def frames(self):
        yield from self._frames


def test_poses_without_gravity_are_turned_upright_by_the_first_floor(tmp_path):
    map_recording(Job.of("map", Held(), Config(), tmp_path / "map"), quiet)
    layers = np.load(tmp_path / "map" / "layers.npz")
    height = layers["elevation"][np.isfinite(layers["elevation"])]
    assert len(height) > 100
    assert np.ptp(height) < 0.03  # one level, although up was not known
    poses = read_tum(tmp_path / "map" / "trajectory.txt")
    assert np.ptp(poses.positions[:, 2]) < 0.01
    assert np.linalg.norm(poses.positions[2] - poses.positions[0]) == pytest.approx(0.1, abs=1e-9)


def test_the_floor_is_height_zero_in_any_axes_of_the_poses_and_the_map_says_how_sure_it_is(
    tmp_path,
):
    turn = Pose3.from_rotation(head_rotation(0.9, -0.6), np.array([3.0, -1.7, 0.6]))
    held = Held(T_place_world=turn)
    mapped = map_recording(Job.of("map", held, Config(), tmp_path / "map"), quiet)
    height = np.load(tmp_path / "map" / "layers.npz")["elevation"]
    assert np.nanmedian(height) == pytest.approx(0.0, abs=0.01)
    assert mapped.walkable_m2 > 0.3
    layers, origin, cell_m = geotiff.load(tmp_path / "map" / "map_layers.tif")
    seen = np.isfinite(layers["occupancy"])
    assert seen.sum() > 100
    assert np.all(layers["occupancy"][seen] < 0.3)
    errors = np.abs(layers["height_m"][seen])
    assert np.all(errors < 3.0 * np.sqrt(layers["height_variance_m2"][seen]))
    poses = read_tum(tmp_path / "map" / "trajectory.txt").positions
    assert poses[:, 2] == pytest.approx(0.8, abs=0.01)  # of the camera above the floor
    assert np.all(np.abs(poses[0, :2] - origin) < cell_m * np.max(seen.shape) + 1.0)


def test_the_distortion_of_a_depth_camera_is_removed_before_fusion(tmp_path):
    lens = replace(CAMERA, distortion=(0.3, 0.0, 0.0, 0.0, 0.0))
    held = Held(up=(0.0, -1.0, 0.0))
    for k, frame in enumerate(held._frames):
        ray = frame.T_world_camera.rotation @ np.moveaxis(lens.rays, -1, 0).reshape(3, -1)
        z = (0.8 / ray[1]).reshape(72, 96).astype(np.float32)
        held._frames[k] = replace(frame, depth=DepthView(np.where(z > 0, z, np.nan), lens))
    map_recording(Job.of("map", held, Config(), tmp_path / "map"), quiet)
    height = np.load(tmp_path / "map" / "layers.npz")["elevation"]
    row, column = np.nonzero(np.isfinite(height))
    places = np.column_stack([row, column, np.ones(len(row))])
    plane, *_ = np.linalg.lstsq(places, height[row, column], rcond=None)
    assert np.max(np.abs(height[row, column] - places @ plane)) < 0.02  # flat
    assert np.hypot(*plane[:2]) / 0.025 < math.radians(0.5)  # and level, cells of 25 mm


def test_a_recording_that_cannot_be_mapped_says_why(tmp_path):
    with pytest.raises(RecordingError, match="held: none of its frames has depth"):
        map_recording(Job.of("map", Held(depth=False), Config(), tmp_path / "a"), quiet)
    lost = Held()
    lost._frames = [replace(frame, T_world_camera=None) for frame in lost._frames]
    with pytest.raises(RecordingError, match="pose of none of its 3 depth images is known"):
        map_recording(Job.of("map", lost, Config(), tmp_path / "b"), quiet)


def test_ignored_poses_become_the_truth_of_the_map(recordings, tmp_path):
    config = replace(Config(), ignore_poses=True)
    job = Job.open(
        "map", recordings / "sevenscenes_redkitchen" / "pan", None, config, tmp_path / "m"
    )
    map_recording(job, quiet)
    true = read_tum(tmp_path / "m" / "truth" / "trajectory.txt")
    given = [frame.T_world_camera for frame in open_recording(job.path).frames()]
    np.testing.assert_array_equal(true.positions, [pose.translation for pose in given])
    metrics = evaluate(RunFolder(tmp_path / "m"), tmp_path / "m" / "truth" / "trajectory.txt")
    assert metrics["ate_m"] < 0.05
    assert math.isfinite(metrics["pose_anees"])


def test_poses_that_are_not_there_cannot_be_ignored(tmp_path):
    config = replace(Config(), ignore_poses=True)
    with pytest.raises(RecordingError, match="no poses that could be ignored"):
        Job.open("map", WALK, None, config, tmp_path / "map")


def test_a_place_beyond_the_range_of_the_surface_is_refused_with_that_range(tmp_path):
    """A wall 9 m ahead; the surface is fused to 5 m."""
    (tmp_path / "wall" / "depth").mkdir(parents=True)
    for number in range(2):
        values = np.full((120, 160), 9000, np.uint16)
        cv2.imwrite(str(tmp_path / "wall" / "depth" / f"{number}.png"), values)
    (tmp_path / "wall" / "recording.toml").write_text(
        "[camera]\nwidth = 160\nheight = 120\nfx = 130.0\nfy = 130.0\ncx = 79.5\ncy = 59.5\n"
        "[depth]\nscale_per_metre = 1000\nnone = [0]\n"
    )
    job = Job.open("map", tmp_path / "wall", None, Config(), tmp_path / "map")
    with pytest.raises(InputError, match=r"surface.farthest_m=5; check the scale"):
        map_recording(job, quiet)
