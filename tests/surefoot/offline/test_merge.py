"""Maps of several sessions merged into one, against the rooms that they were rendered from."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mapping.surface.tsdf_config import TsdfConfig
from perception.odometry.session_graph import BELIEVED
from perception.primitives.camera import Camera
from perception.primitives.errors import InputError, OutputError, RecordingError
from perception.primitives.frame import ColourView, DepthView, Frame
from perception.primitives.pose import Pose3, head_rotation
from surefoot.config.schema import Config
from surefoot.evaluation.metrics.trajectory import align, distances
from surefoot.offline.job import Job
from surefoot.offline.map import map_recording
from surefoot.offline.mapped_session import MappedSession, read_images
from surefoot.offline.merge import merge
from surefoot.recordings.codec import encode
from surefoot.recordings.mcap_format import RecordingWriter
from surefoot.recordings.recording import RecordingInfo
from surefoot.results.run_folder import RunFolder
from surefoot.results.tables import read_tum

CAMERA = Camera(240, 180, 200.0, 200.0, 119.5, 89.5)
ROOM = ((-2.5, -2.0, 0.0), (2.5, 2.0, 2.4))
OTHER = ((-1.8, -3.0, 0.0), (3.4, 1.6, 2.6))
CUPBOARD = ((1.9, 0.5, 0.0), (2.5, 1.4, 1.7))
BOX = ((1.2, -0.9, 0.0), (1.6, -0.5, 0.5))
MOVED = ((1.2, -0.1, 0.0), (1.6, 0.3, 0.5))
FRAMES = 9  # of each session
SAME = (
    "trajectory.txt", "space_covariance.csv", "graph.g2o", "mesh.ply", "cloud.ply", "map.pgm", "layers.npz",
    "sessions.json", "changes.json",
)  # fmt: skip


def quiet(text):
    pass


def picture(boxes, paint, pose, rng):
    """Depth with noise, and a pattern of fixed spots on every surface."""
    spots = np.random.default_rng(paint).random((64, 64, 64)) * 180.0 + 40.0
    directions = CAMERA.rays @ pose.rotation.T
    z, of = np.full(directions.shape[:2], np.inf), np.zeros(directions.shape[:2], int)
    for number, (low, high) in enumerate(boxes):
        with np.errstate(divide="ignore"):
            first = (np.array(low) - pose.position) / directions
            second = (np.array(high) - pose.position) / directions
        near, far = np.minimum(first, second).max(axis=-1), np.maximum(first, second).min(axis=-1)
        hit = far if number == 0 else np.where((near < far) & (near > 0.0), near, np.inf)
        of, z = np.where(hit < z, number, of), np.minimum(z, hit)
    lows = np.array([low for low, _ in boxes])[of]  # a box carries its pattern along
    at = np.floor((pose.position + directions * z[..., None] - lows) / 0.11 + 0.003).astype(int)
    x, y, w = ((at[..., axis] + 7 * of) % 64 for axis in range(3))
    z = z + rng.standard_normal(z.shape) * (0.0012 + 0.0019 * (z - 0.4) ** 2)
    rgb = np.repeat(spots[x, y, w][..., None], 3, axis=2).astype(np.uint8)
    return DepthView(z.astype(np.float32), CAMERA), ColourView(rgb, CAMERA)


def walked(path, boxes, paint, begin, seed, hz=5.0, ignore_poses=True):
    """A recording of a camera that goes along and turns, and its map, by default without the poses."""
    rng, rows = np.random.default_rng(seed), []
    info = RecordingInfo(
        path.name, "simulation", poses_given=True, gravity_up_world=(0.0, 0.0, 1.0)
    )
    with RecordingWriter(path.with_suffix(".mcap"), info) as writer:
        for k in range(FRAMES):
            n = begin + k
            R = head_rotation(-0.75 + 0.08 * n, 0.40)
            pose = Pose3.from_rotation(
                R, np.array([-1.7 + 0.05 * n, 0.2 - 0.005 * n * n, 1.3 + 0.01 * n])
            )
            depth, colour = picture(boxes, paint, pose, rng)
            rows.append((k / hz, *pose.translation, *pose.quat_xyzw))
            writer.write(encode(Frame(k / hz, depth=depth, colour=colour, T_world_camera=pose)))
    config = replace(Config(), ignore_poses=ignore_poses, surface=TsdfConfig(voxel_m=0.04))
    job = Job.open("map", path.with_suffix(".mcap"), None, config, path)
    folder = Path(map_recording(job, quiet).folder)
    (folder / "truth").mkdir(exist_ok=True)  # a map with the poses keeps none
    np.savetxt(folder / "truth/trajectory.txt", rows)
    return folder


@pytest.fixture(scope="module")
def maps(tmp_path_factory):
    """Two sessions of a room in which a box was moved, and one of another room."""
    place = tmp_path_factory.mktemp("sessions")
    return [
        walked(place / "monday", [ROOM, CUPBOARD, BOX], 3, 0, 1),
        walked(place / "tuesday", [ROOM, CUPBOARD, MOVED], 3, 4, 2),
        walked(place / "elsewhere", [OTHER, BOX], 8, 2, 3),
    ]


@pytest.fixture(scope="module")
def merged(maps, tmp_path_factory, pages):
    """The three merged."""
    out = tmp_path_factory.mktemp("out") / "merged"
    with pages():
        return merge(maps, out, quiet), out


def true_poses(maps, out):
    """Positions in the merged map and in the world."""
    content = json.loads((out / "sessions.json").read_text())
    found = read_tum(out / "trajectory.txt")
    mine, true = [], []
    for one in content["sessions"]:
        if one["part"] == 1:
            truth = read_tum(Path(one["map"]) / "truth" / "trajectory.txt")
            within = (found.stamps >= one["from_s"] - 1e-6) & (found.stamps <= one["to_s"] + 1e-6)
            mine.append(found.positions[within])
            true.append(truth.positions)
    return np.concatenate(mine), np.concatenate(true)


def test_sessions_of_one_room_are_one_map_and_another_room_stays_apart(maps, merged):
    summary, out = merged
    content = json.loads((out / "sessions.json").read_text())
    names = {one["session"]: one["name"] for one in content["sessions"]}
    assert sorted(names[k] for k in content["parts"][0]) == ["monday", "tuesday"]
    assert [names[k] for k in content["parts"][1]] == ["elsewhere"]
    for pair in content["pairs"]:
        related = "elsewhere" not in {names[k] for k in pair["sessions"]}
        assert pair["merged"] == related
        assert (pair["probability"] >= BELIEVED) if related else (pair["probability"] < 0.1)
    assert any("elsewhere" in line or "alone" in line for line in summary.lines())
    assert (out / "part-2" / "mesh.ply").is_file()


def test_the_cameras_of_both_sessions_are_where_they_were(maps, merged):
    mine, true = true_poses(maps, merged[1])
    assert len(mine) == 2 * FRAMES
    errors = distances(align(mine, true).apply(mine), true)
    assert np.sqrt(np.mean(errors**2)) < 0.01


def assert_box_moved(maps, out):
    """The only change is the box, at both of its places."""
    changes = json.loads((out / "changes.json").read_text())["changes"]
    assert [change["kind"] for change in changes] == ["moved"]
    assert changes[0]["probability"] > 0.5
    mine, true = true_poses(maps, out)
    motion = align(mine, true)
    content = json.loads((out / "sessions.json").read_text())
    first = next(one["session"] for one in content["sessions"] if one["name"] == "monday")
    places = (BOX, MOVED) if changes[0]["sessions"][0] == first else (MOVED, BOX)
    for key, box in zip(("before", "after"), places, strict=True):
        found = motion.apply(np.array([[*changes[0][key]["position_m"], 0.0]]))[0, :2]
        assert np.linalg.norm(found - (np.array(box[0]) + np.array(box[1]))[:2] / 2) < 0.2


def test_the_moved_box_is_found_and_nothing_else(maps, merged):
    assert_box_moved(maps, merged[1])


def test_an_unsure_heading_of_the_first_image_hides_no_change(tmp_path):
    """The given poses of a camera that turns fast are unsure, and with them its heading in each image."""
    fast = [
        walked(tmp_path / "monday", [ROOM, CUPBOARD, BOX], 3, 0, 1, 400.0, ignore_poses=False),
        walked(tmp_path / "tuesday", [ROOM, CUPBOARD, MOVED], 3, 4, 2, 400.0, ignore_poses=False),
    ]
    merge(fast, tmp_path / "merged", quiet, report=False)
    assert_box_moved(fast, tmp_path / "merged")


def test_it_is_a_map_folder_with_a_picture_of_the_sessions(merged):
    summary, out = merged
    run = RunFolder.open(out)
    assert run.kind == "map"
    names = {path.name for path in out.iterdir()}
    assert names >= {
        "trajectory.txt", "space_covariance.csv", "graph.g2o", "mesh.ply", "cloud.ply", "map.yaml", "map.pgm",
        "map_layers.tif", "layers.npz", "config.toml", "summary.json", "report.html", "replay.html",
    }  # fmt: skip
    assert "Sessions and changes" in (out / "report.html").read_text()
    assert summary.lines()[-1] == f"map folder: {out}"
    P = run.read_csv("space_covariance.csv").numbers("start_00")
    assert np.all(P >= 0.0)
    assert P[-1] > P[0]


def test_any_order_gives_the_same_bytes(maps, merged, tmp_path):
    merge([maps[2], maps[1], maps[0]], tmp_path / "again", quiet)
    for name in SAME:
        assert (tmp_path / "again" / name).read_bytes() == (merged[1] / name).read_bytes(), name


def test_one_map_or_the_same_map_twice_is_refused(maps, tmp_path):
    with pytest.raises(InputError, match="two at least"):
        merge(maps[:1], tmp_path / "out", quiet)
    copy = shutil.copytree(maps[0], tmp_path / "copy")
    with pytest.raises(InputError, match="are the same map"):
        merge([maps[0], copy], tmp_path / "out", quiet)
    assert not (tmp_path / "out").exists()


def test_what_is_no_map_is_refused_with_what_to_do(maps, merged, tmp_path):
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="holds no results"):
        merge([maps[0], tmp_path / "empty"], tmp_path / "out", quiet)
    with pytest.raises(InputError, match="merged map; give the maps"):
        merge([maps[0], merged[1]], tmp_path / "out", quiet)
    broken = shutil.copytree(maps[1], tmp_path / "broken")
    (broken / "trajectory.txt").unlink()
    with pytest.raises(InputError, match="is no finished map"):
        merge([maps[0], broken], tmp_path / "out", quiet)
    with pytest.raises(OutputError, match="is one of the maps"):
        merge(maps[:2], maps[0], quiet)


def test_a_recording_that_is_gone_is_named(maps, tmp_path):
    moved = shutil.copytree(maps[1], tmp_path / "moved")
    summary = json.loads((moved / "summary.json").read_text())
    summary["recording"] = str(tmp_path / "gone.mcap")
    (moved / "summary.json").write_text(json.dumps(summary))
    with pytest.raises(InputError, match=r"gone\.mcap is gone; merging reads its images again"):
        merge([maps[0], moved], tmp_path / "out", quiet)


def test_a_recording_with_other_images_is_refused(maps, tmp_path):
    moved = shutil.copytree(maps[1], tmp_path / "moved")
    lines = (moved / "trajectory.txt").read_text().splitlines()
    late = [line if line.startswith("#") else "9" + line for line in lines]
    (moved / "trajectory.txt").write_text("\n".join(late))
    with pytest.raises(InputError, match="has none of the 9 images of the map"):
        read_images(MappedSession.open(moved), quiet)


@pytest.mark.parametrize(
    ("name", "content", "error"),
    [
        ("summary.json", "{", RecordingError),
        ("trajectory.txt", "0 1 2\n", RecordingError),
        ("graph.g2o", "VERTEX_SE3:QUAT 0 0 0\n", InputError),
        ("graph.g2o", "VERTEX_SE3:QUAT 99 0 0 0 0 0 0 1\nVERTEX_SE3:QUAT 100 0 0 0 0 0 0 1\nEDGE_SE3:QUAT 99 100 1 0 0 0 0 0 1 "
         + " ".join("1" if i == j else "0" for i in range(6) for j in range(i, 6)), InputError),
        ("tracking.csv", "stamp_s,state\n1\n", RecordingError),
    ],
)  # fmt: skip
def test_damaged_files_are_named(maps, tmp_path, name, content, error):
    broken = shutil.copytree(maps[1], tmp_path / "broken")
    (broken / name).write_text(content)
    with pytest.raises(error, match=name.replace(".", r"\.")):
        read_images(MappedSession.open(broken), quiet)
