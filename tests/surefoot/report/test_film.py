"""The moving picture shows the walk of the estimates; the one in docs/ is of this version."""

from __future__ import annotations

import importlib.metadata
import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from mapping.ground.surface import Border
from perception.primitives.camera import Camera
from perception.primitives.errors import InputError, OutputError
from perception.primitives.gaussian import Gaussian
from perception.primitives.pose import Pose3, head_rotation
from surefoot.report.film import LARGEST_BYTES, LEFT_PX, film
from surefoot.report.film_map import BLUE, MARGIN_M, RED
from surefoot.results.moment import UNKNOWN, Layers, Moment, SurfaceSeen
from surefoot.results.moments import MomentWriter
from surefoot.results.run_folder import RunFolder

DOCS = Path(__file__).parents[3] / "docs"
LENS = Camera.from_view(64, 64, 1.0, 1.0)


def moment(k, steps):
    """A camera that moves 3 m along x; the map ahead of it is free, with a wall at y = 1."""
    x = 3.0 * k / (steps - 1)
    probability = np.zeros((41, 41), np.uint8)
    probability[40] = 254
    probability[0] = UNKNOWN
    height = np.zeros((41, 41), np.float32)
    picture = cv2.imencode(".jpg", np.full((64, 64, 3), 90 + k, np.uint8))[1].tobytes()
    view = Pose3.from_rotation(head_rotation(0.0, 0.3), np.array([x, 0.0, 0.4]))
    pose = Gaussian(np.array([x, 0.0, 0.0]), np.diag([0.01, 0.0004, 0.001]))
    return Moment(
        0.5 * k,
        pose,
        {"colour": view},
        {"colour": LENS},
        grid=Layers(np.array([x - 1.0, -1.0]), 0.05, probability, probability, height),
        colour=picture,
        colour_sensor="colour",
    )


def run_of(tmp_path, moments):
    run = RunFolder.create(tmp_path / "run")
    writer = MomentWriter(run)
    for one in moments:
        writer.write(one)
    writer.close(())
    return run


def blue(frame):
    """Columns of the drawn path."""
    map_part = frame[:, LEFT_PX:, :3].astype(int)
    near = np.abs(map_part - BLUE).max(axis=2) < 60
    return np.flatnonzero(near.any(axis=0))


def test_the_path_grows_from_picture_to_picture(tmp_path):
    run = run_of(tmp_path, [moment(k, 21) for k in range(21)])
    out = film(run, tmp_path / "walk.webp")
    assert out.stat().st_size < LARGEST_BYTES
    read, animation = cv2.imreadanimation(str(out))
    assert read
    assert len(animation.frames) == 21
    ends = [int(columns.max()) for columns in map(blue, animation.frames[2:])]
    assert ends == sorted(ends)
    about = json.loads((tmp_path / "walk.json").read_text())
    width, height = about["size_px"]
    assert animation.frames[0].shape[:2] == (height, width)
    share = (ends[-1] - ends[0]) / (width - LEFT_PX)
    assert share == pytest.approx(3.0 * 18 / 20 / 5.05, abs=0.03)  # of the width of the map, m


def test_surfaces_are_drawn_where_they_are_with_red_sides_where_they_drop(tmp_path):
    corners = np.array([[0.0, -0.5, 0.1], [2.0, -0.5, 0.1], [2.0, 0.5, 0.1], [0.0, 0.5, 0.1]])
    borders = np.array([Border.RISE, Border.DROP, Border.RISE, Border.UNSEEN])
    seen = (SurfaceSeen(corners, borders),)
    walked = [replace(moment(k, 5), grid=None, surfaces=seen if k == 0 else None) for k in range(5)]
    out = film(run_of(tmp_path, walked), tmp_path / "walk.webp")
    _, animation = cv2.imreadanimation(str(out))
    drawn = animation.frames[-1][:, LEFT_PX:, :3].astype(int)
    red = np.flatnonzero((np.abs(drawn - RED).max(axis=2) < 60).sum(axis=0) > 20)
    scale = drawn.shape[1] / (3.0 + 2 * MARGIN_M)  # the path is 3 m long
    assert red.min() / scale - MARGIN_M == pytest.approx(2.0, abs=0.05)
    assert red.max() / scale - MARGIN_M == pytest.approx(2.0, abs=0.05)


def test_a_run_that_stands_nowhere_is_refused(tmp_path):
    run = run_of(tmp_path, [Moment(0.0), Moment(1.0)])
    with pytest.raises(InputError, match="0 moments with a pose; a film needs a walk"):
        film(run, tmp_path / "walk.webp")


def test_a_run_that_ended_in_its_first_moment_is_refused_with_what_to_do(tmp_path):
    run = run_of(tmp_path, [moment(0, 2)])
    with pytest.raises(InputError, match=r"1 moment with a pose.*process --resume"):
        film(run, tmp_path / "walk.webp")


def test_a_folder_that_is_not_there_is_named(tmp_path):
    run = run_of(tmp_path, [moment(k, 3) for k in range(3)])
    with pytest.raises(OutputError, match="choose another --out"):
        film(run, tmp_path / "nowhere" / "walk.webp")


@pytest.mark.parametrize("said", [True, False])
def test_a_full_disk_is_named_and_leaves_the_former_film(tmp_path, monkeypatch, said):
    """/dev/full takes no byte; OpenCV may say that all is written."""

    def on_full_disk(path, *_):
        Path(path).unlink()
        Path(path).symlink_to("/dev/full")
        return said

    monkeypatch.setattr(cv2, "imwriteanimation", on_full_disk)
    out = tmp_path / "walk.webp"
    out.write_bytes(b"former")
    with pytest.raises(OutputError, match="No space left on device"):
        film(run_of(tmp_path, [moment(k, 3) for k in range(3)]), out)
    assert out.read_bytes() == b"former"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["run", "walk.webp"]


@pytest.mark.parametrize("name", ["walk", "climb"])
def test_the_films_of_the_documentation_are_of_this_version_and_below_three_megabytes(name):
    about = json.loads((DOCS / f"{name}.json").read_text())
    assert about["version"] == importlib.metadata.version("surefoot")
    read, animation = cv2.imreadanimation(str(DOCS / f"{name}.webp"))
    assert read
    assert len(animation.frames) == about["frames"]
    assert (DOCS / f"{name}.webp").stat().st_size < 3_000_000
