"""The map of a whole recording, held against what is known of the place."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from scipy import ndimage

from perception.primitives.errors import RecordingError
from surefoot.config.schema import Config
from surefoot.evaluation.metrics.trajectory import trajectory_metrics
from surefoot.offline.map import map_recording
from surefoot.recordings.open import open_recording
from surefoot.results.tables import read_tum

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


@pytest.fixture(scope="module")
def cabinet(recordings, tmp_path_factory):
    """A box on a bare floor, its recording without any pose; and the true way."""
    source, folder = recordings / "tum_fr3_cabinet", tmp_path_factory.mktemp("cabinet")
    truth = source / "groundtruth.txt"
    lines = [line for line in truth.read_text().splitlines() if not line.startswith("#")]
    (folder / "stamps.txt").write_text("\n".join(line.split()[0] for line in lines))
    (folder / "recording.toml").write_text(DESCRIPTION)
    for part in ("depth", "rgb"):
        shutil.copytree(source / part, folder / part)
    said = []
    mapped = map_recording(open_recording(folder), folder / "map", Config(), said.append)
    return mapped, Path(mapped.folder), truth, said


def test_the_way_is_found_without_a_pose(cabinet):
    mapped, folder, truth, _ = cabinet
    figures = trajectory_metrics(read_tum(folder / "trajectory.txt"), read_tum(truth))
    assert figures["matched_poses"] == 38
    assert figures["ate_aligned_m"] <= 0.03
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


def test_everything_is_there_and_can_be_opened(cabinet):
    import open3d as o3d

    mapped, folder, _, said = cabinet
    names = {path.name for path in folder.iterdir() if not path.name.startswith(".")}
    assert names >= {
        "trajectory.txt", "graph.g2o", "mesh.ply", "cloud.ply", "map.yaml", "map.pgm", "layers.npz",
        "summary.json",
    }  # fmt: skip
    mesh = o3d.io.read_triangle_mesh(str(folder / "mesh.ply"))
    assert len(mesh.vertices) == mapped.vertices
    assert mesh.has_vertex_colors()
    assert json.loads((folder / "summary.json").read_text())["frames"] == 38
    assert said[0].startswith("way: frame 1 of 38")


def test_a_recording_that_cannot_be_mapped_says_why(tmp_path):
    walk = Path(__file__).parents[3] / "data" / "walk"  # time of flight on a walking body
    with pytest.raises(RecordingError, match="RGB-D camera is expected"):
        map_recording(open_recording(walk), tmp_path / "map", Config(), lambda text: None)
