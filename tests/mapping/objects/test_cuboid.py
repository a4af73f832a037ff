"""A box fitted to one view: rendered boxes of known size, and real ones."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from mapping.objects import cuboid
from perception.depth import structured_light
from perception.depth.points import from_depth
from perception.floor import choose
from perception.floor.prior import handheld_prior
from perception.primitives.camera import Camera
from perception.primitives.errors import InputError
from perception.primitives.frame import Depth, DepthView
from perception.primitives.plane import Plane
from perception.primitives.pose import Pose3, head_rotation

CAMERA = Camera(320, 240, 270.0, 270.0, 160.0, 120.0)
REALSENSE = Camera(640, 480, 617.25, 617.549, 317.392, 245.98)


def looking(height_m, tilt_rad):
    return Pose3.from_rotation(head_rotation(0.0, tilt_rad), np.array([0.0, 0.0, height_m]))


def rendered(pose, centre, size, yaw, noise_m=0.0, seed=0):
    """Depth of a box on an endless floor before a wall at 5 m, ray by ray."""
    rays = CAMERA.rays @ pose.rotation.T
    origin = pose.position
    with np.errstate(divide="ignore", invalid="ignore"):
        z = np.where(rays[..., 2] < 0.0, -origin[2] / rays[..., 2], np.inf)
        z = np.minimum(z, np.where(rays[..., 0] > 0.0, (5.0 - origin[0]) / rays[..., 0], np.inf))
        c, s = math.cos(yaw), math.sin(yaw)
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        local = (origin - np.array([*centre, size[2] / 2])) @ turn
        directions = rays @ turn
        low, high = (
            (-np.array(size) / 2 - local) / directions,
            (np.array(size) / 2 - local) / directions,
        )
    enter = np.minimum(low, high).max(axis=-1)
    leave = np.maximum(low, high).min(axis=-1)
    z = np.where((enter < leave) & (enter > 0.0), np.minimum(z, enter), z)
    z = z + noise_m * np.random.default_rng(seed).standard_normal(z.shape)
    sigma = np.full(z.shape, max(noise_m, 0.001), np.float32)
    floor = Plane(pose.rotation[2], pose.position[2], np.diag([1e-6, 1e-6, 1e-6]))
    return Depth(z.astype(np.float32), sigma, CAMERA), floor


def fitted(depth, floor):
    labels = cuboid.label_objects(depth, floor, 3.5)
    return cuboid.fit(depth, floor, labels == 1)


@settings(deadline=None, max_examples=6)
@example(yaw=0.0, length=0.4375, width=0.25, height=0.5)  # edges along pixel columns
@given(
    st.floats(-0.7, 0.7), st.floats(0.4, 0.7), st.floats(0.25, 0.38), st.floats(0.2, 0.5),
)  # fmt: skip
def test_a_box_seen_from_above_has_its_size(yaw, length, width, height):
    depth, floor = rendered(looking(1.1, 0.6), (1.5, 0.0), (length, width, height), yaw)
    found = fitted(depth, floor)
    # 6 mm across; along the floor, viewed obliquely, 1.6 / (1.1 - height) times that
    pixel = 1.6 / CAMERA.fx
    assert found.top
    assert not found.cut
    assert found.height_m == pytest.approx(height, abs=0.003)
    assert found.length_m == pytest.approx(length, abs=2 * pixel)
    assert found.width_m == pytest.approx(width, abs=2 * pixel)


def test_sizes_have_no_pixel_bias():
    """At pixel centres the sides would be a pixel too short on average; the limit is a quarter pixel."""
    off = []
    for k in range(8):
        size = (0.5 + 0.002 * k, 0.31 - 0.002 * k, 0.35)
        depth, floor = rendered(looking(1.1, 0.6), (1.4 + 0.01 * k, 0.05), size, 0.3 + 0.07 * k)
        found = fitted(depth, floor)
        off.append((found.length_m - size[0], found.width_m - size[1]))
    assert np.all(np.abs(np.mean(off, axis=0)) < 0.25 * 1.6 / CAMERA.fx)


def test_standard_deviations_cover_the_errors_under_noise():
    inside = []
    for seed in range(5):
        size = (0.6, 0.4, 0.4)
        depth, floor = rendered(looking(1.1, 0.6), (1.5, -0.1), size, 0.2 * seed, 0.004, seed)
        found = fitted(depth, floor)
        inside += [
            abs(found.length_m - size[0]) < 2.5 * found.sigma_length_m,
            abs(found.width_m - size[1]) < 2.5 * found.sigma_width_m,
            abs(found.height_m - size[2]) < 2.5 * found.sigma_height_m,
        ]
    assert np.mean(inside) > 0.9


def test_a_front_alone_gives_length_and_height_and_marks_the_width_unknown():
    depth, floor = rendered(looking(0.2, 0.0), (1.3, 0.0), (0.2, 0.5, 0.3), 0.0)
    found = fitted(depth, floor)
    assert found.length_m == pytest.approx(0.5, abs=0.006)
    assert found.height_m == pytest.approx(0.3, abs=0.006)
    assert found.seen_length
    assert not found.seen_width
    assert not found.top


def test_a_box_at_the_image_border_is_cut():
    depth, floor = rendered(looking(1.1, 0.6), (1.5, 0.85), (0.6, 0.4, 0.4), 0.2)
    assert fitted(depth, floor).cut


def test_the_pose_of_the_box_is_found():
    pose = looking(1.1, 0.6)
    depth, floor = rendered(pose, (1.5, 0.1), (0.6, 0.35, 0.4), 0.5)
    T_world_box = pose @ fitted(depth, floor).T_camera_box
    np.testing.assert_allclose(T_world_box.position, [1.5, 0.1, 0.0], atol=0.006)
    along = T_world_box.rotation[:, 0]
    assert abs(along @ [math.cos(0.5), math.sin(0.5), 0.0]) > math.cos(math.radians(1.0))


def test_objects_are_separated_by_depth_and_numbered_by_size():
    pose = looking(1.1, 0.6)
    near, floor = rendered(pose, (1.2, 0.25), (0.3, 0.3, 0.3), 0.0)
    far, _ = rendered(pose, (1.9, -0.1), (0.3, 0.5, 0.5), 0.0)
    both = Depth(np.minimum(near.z, far.z), near.sigma, CAMERA)
    labels = cuboid.label_objects(both, floor, 3.5)
    assert labels.max() == 2
    counts = np.bincount(labels.ravel())[1:]
    assert counts[0] >= counts[1]


def test_a_bare_floor_has_no_objects():
    depth, floor = rendered(looking(1.1, 0.6), (9.0, 0.0), (0.1, 0.1, 0.1), 0.0)
    labels = cuboid.label_objects(depth, floor, 3.0)
    assert labels.max() == 0
    assert cuboid.fit(depth, floor, labels == 1) is None


def test_a_mask_of_another_shape_is_refused():
    depth, floor = rendered(looking(1.1, 0.6), (1.5, 0.0), (0.5, 0.4, 0.4), 0.0)
    with pytest.raises(InputError, match="mask"):
        cuboid.fit(depth, floor, np.zeros((3, 3), bool))


def floor_in(depth):
    cloud = from_depth(depth, 0.15, 4.0)
    found = choose.find(cloud, handheld_prior(None), np.random.default_rng(0), sensor="depth")
    return found.plane


def test_a_cabinet_has_its_size_in_single_views(recordings):
    """Kinect round a cabinet of 0.79 x 0.45 m, top at 0.554 m; the truth itself is good to 2 cm."""
    reader = pytest.importorskip("surefoot.recordings.open", reason="reads a recording")
    frames = list(reader.open_recording(recordings / "tum_fr3_cabinet").frames())
    off = []
    for frame in frames[::9]:
        depth = structured_light.depth(frame.depth)
        floor = floor_in(depth)
        found = cuboid.fit(depth, floor, cuboid.label_objects(depth, floor) == 1)
        off.append([found.height_m - 0.5543, found.width_m - 0.4455, found.length_m - 0.7926])
    assert np.all(np.median(np.abs(off), axis=0) < [0.010, 0.025, 0.025])


def test_a_carton_has_the_same_size_in_different_frames(recordings):
    sizes = []
    for number in (0, 2, 3):
        path = recordings / "realsense_low_boxes" / "depth" / f"{number:06d}.png"
        raw = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        z = np.where(raw == 0, np.nan, raw / 1000.0).astype(np.float32)
        depth = structured_light.depth(DepthView(z, REALSENSE))
        floor = floor_in(depth)
        boxes = (cuboid.fit(depth, floor, cuboid.label_objects(depth, floor) == k) for k in (1, 2))
        (whole,) = [box for box in boxes if box is not None and not box.cut]
        sizes.append((whole.length_m, whole.height_m))
    assert np.all(np.ptp(np.array(sizes), axis=0) < 0.02)
