"""The floor of several views: against the true floor of synthetic rooms and of real recordings."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation

from perception.depth.distortion import DistortionConfig
from perception.floor.common_floor import find_common, floor_view
from perception.floor.levelling import UP
from perception.primitives.camera import Camera
from perception.primitives.plane import Plane
from perception.primitives.pose import Pose2, Pose3

TABLE = (0.2, 1.6, -2.0, 2.0, 0.64, 0.65)  # a camera that looks over it sees nothing else
NARROW_TABLE = (0.6, 1.3, -0.5, 0.5, 0.60, 0.65)
UPRIGHT = Pose3()
TURNED = Pose3.from_rotation(
    Rotation.random(random_state=3).as_matrix(), np.array([50.0, -20.0, 8.0])
)
KITCHEN = Camera(640, 480, 585.0, 585.0, 320.0, 240.0)


def walk_round(look, seed, world=UPRIGHT, count=6, sensor=None, **room):
    """Views on a circle of 0.5 m, their true floor z = 0 moved into the world."""
    views = []
    for k in range(count):
        seen = look(100 * seed + k, height_m=1.2, pitch_deg=35.0, size=(120, 90), **room)
        yaw = 2.0 * np.pi * k / count
        place = Pose2(0.5 * np.cos(yaw), 0.5 * np.sin(yaw), yaw).lifted()
        views.append(floor_view(seen.points, world @ place @ seen.T_body_camera, sensor))
    return views, Plane(UP, 0.0).moved(world)


@pytest.mark.parametrize("world", [UPRIGHT, TURNED])
@pytest.mark.parametrize("up_known", [False, True])
def test_the_floor_is_found_in_any_axes_and_the_table_is_not_taken_for_it(look, world, up_known):
    floors, true = walk_round(look, 0, world, 3, boxes=(NARROW_TABLE,))
    over_table, _ = walk_round(look, 1, world, 9, boxes=(TABLE,), with_floor=False, wall_m=20.0)
    tilted = Rotation.from_rotvec([0.07, 0.0, 0.0]).apply(UP)  # 4 deg wrong
    up = world.rotation @ tilted if up_known else None
    found = find_common([*over_table, *floors], up, np.random.default_rng(0))
    camera = floors[0].T_world_camera.position
    height, sigma = found.height_of(camera)
    assert abs(height - 1.2) < min(0.01, 3.0 * sigma)
    assert np.degrees(found.plane.angle_to(true)) < 0.5
    assert set(found.views) == {9, 10, 11}
    level = found.T_level_world.apply(world.apply(np.array([[0.3, 0.2, 0.0], [0.0, 0.0, 1.0]])))
    np.testing.assert_allclose(level[:, 2], [0.0, 1.0], atol=0.01)


def test_views_of_a_place_without_a_floor_have_none(look):
    views, _ = walk_round(look, 0, count=3, with_floor=False, wall_m=2.0)
    assert find_common(views, None, np.random.default_rng(0)) is None
    assert find_common([], None, np.random.default_rng(0)) is None


def test_a_view_in_which_the_search_settles_on_a_wall_does_not_count(look):
    for seed in range(6):
        floors, true = walk_round(look, seed, count=3)
        size = {"size": (120, 90), "with_floor": False, "wall_m": 1.2}
        wall = look(900 + seed, height_m=1.2, pitch_deg=25.0, **size)
        views = [*floors, floor_view(wall.points, wall.T_body_camera)]
        found = find_common(views, None, np.random.default_rng(0))
        assert found is not None
        assert found.views == (0, 1, 2)
        assert np.degrees(found.plane.angle_to(true)) < 0.5


def test_a_plane_above_a_camera_is_no_floor(look):
    over_table, _ = walk_round(look, 0, count=3, boxes=(TABLE,), with_floor=False, wall_m=20.0)
    below = look(7, height_m=0.3, pitch_deg=-20.0)  # under the table top, it sees a wall
    views = [*over_table, floor_view(below.points, below.T_body_camera)]
    assert find_common(over_table, None, np.random.default_rng(0)) is not None
    assert find_common(views, None, np.random.default_rng(0)) is None


def test_the_covariance_is_consistent_with_errors_that_all_views_share(look):
    share = DistortionConfig().depth.share
    squares = []
    for seed in range(30):
        bent = tuple(share * np.random.default_rng(seed).standard_normal(3))
        views, true = walk_round(look, seed, count=4, sensor="depth", scale=bent)
        found = find_common(views, None, np.random.default_rng(0))
        error = found.plane.error_to(true)
        squares.append(error @ np.linalg.solve(found.plane.covariance, error))
    # never surer than it is right; views all round cancel part of the bend, so it may be careful
    assert np.mean(squares) < stats.chi2.ppf(0.99, 3 * 30) / 30


@pytest.mark.parametrize("part", ["sweep", "pan"])
def test_the_kitchen_floor_is_five_centimetres_right_below_every_camera(
    recordings, read_floors, read_points, part
):
    folder = recordings / "sevenscenes_redkitchen"
    known = read_floors(folder / "floor.csv")
    paths = sorted((folder / part).glob("frame-*.depth.png"))[::4]
    views = []
    for path in paths:
        matrix = np.loadtxt(str(path).replace("depth.png", "pose.txt"))
        pose = TURNED @ Pose3.from_matrix(matrix)
        views.append(floor_view(read_points(path, KITCHEN, 1000.0), pose, "depth"))
    found = find_common(views, None, np.random.default_rng(0))
    for path, view in zip(paths, views, strict=True):
        height, sigma = found.height_of(view.T_world_camera.position)
        error = height - known[path.name[6:12]].offset_m
        assert abs(error) <= 0.05
        assert abs(error) <= 3.0 * np.hypot(sigma, 0.03)  # the truth is known to 3 cm
