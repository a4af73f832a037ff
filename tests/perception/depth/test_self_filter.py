"""The self-filter: no ray that meets the body stays, few others go, and what it cannot know it leaves alone."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from perception.depth.self_filter import NEAR_M, blackened, silhouette, without_self
from perception.primitives.camera import Camera
from perception.primitives.errors import InputError
from perception.primitives.frame import ColourView, Depth
from perception.primitives.kinematics import Joint, KinematicTree
from perception.primitives.own_body import JointReading, OwnBody, OwnPart
from perception.primitives.pose import CAMERA_IN_BODY_AXES, Pose3, head_rotation

CAMERA = Camera.from_view(64, 48, math.radians(80), math.radians(60))
AHEAD = Pose3.from_rotation(CAMERA_IN_BODY_AXES, np.array([0.0, 0.0, 1.0]))
CUBE = 0.1 * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
RIM = np.ones((5, 5), np.uint8)  # rounded corners and pixels
TREE = KinematicTree((Joint("hip", 0, Pose3(), (0.0, 0.0, 1.0), -3.0, 3.0),))


def body(margin_m=0.0, sigma_rad=0.0, corners=CUBE):
    return OwnBody(TREE, (OwnPart("hand", 1, corners, margin_m, sigma_rad),))


def at(x, y, z, angle=0.0):
    return JointReading(Pose3((x, y, z)), (angle,))


def met(own, joints, camera, pose, near_m=0.0):
    """Pixels whose ray meets the cube of the body beyond a distance from the plane of the lens."""
    found = meets(own, joints, camera.rays.reshape(-1, 3), pose, near_m)
    return found.reshape(camera.height, camera.width)


def meets(own, joints, rays, pose, near_m):
    """The same of rays (n, 3) of depth 1, by the slabs of a box in its own frame."""
    (angle,) = joints.angles
    turn = np.array([[math.cos(angle), math.sin(angle), 0], [-math.sin(angle), math.cos(angle), 0], [0, 0, 1]])  # fmt: skip
    rays = rays @ pose.rotation.T @ turn.T
    eye = turn @ (pose.position - joints.T_body_base.position)
    low, high = own.parts[0].corners.min(0), own.parts[0].corners.max(0)
    with np.errstate(divide="ignore", invalid="ignore"):
        one, other = (low - eye) / rays, (high - eye) / rays
    enter, leave = np.minimum(one, other).max(axis=1), np.maximum(one, other).min(axis=1)
    return (enter <= leave) & (leave > near_m)


def beyond_rim(mask, own, joints, camera, pose):
    """Pixels of the mask from which the body is more than two pixels away, also what is beside the image.

    Where no pixel near sees it, rays between pixels are tried: a tip may lie among them.
    """
    larger = replace(
        camera, width=camera.width + 4, height=camera.height + 4, cx=camera.cx + 2, cy=camera.cy + 2
    )
    truth = met(own, joints, larger, pose, NEAR_M).astype(np.uint8)
    doubtful = mask & (cv2.dilate(truth, RIM)[2:-2, 2:-2] == 0)
    around = np.stack(np.meshgrid(*[np.linspace(-2.5, 2.5, 81)] * 2), axis=-1).reshape(-1, 2)
    far = 0
    for v, u in np.argwhere(doubtful):
        rays = camera.back_project(np.array([u, v]) + around, np.ones(len(around)))
        far += not meets(own, joints, rays, pose, NEAR_M).any()
    return far


@given(st.floats(0.15, 2.0), st.floats(-0.8, 0.8), st.floats(0.4, 1.6), st.floats(-1.5, 1.5))
def test_no_ray_that_meets_the_body_stays_and_few_others_go(x, y, z, angle):
    own, joints = body(), at(x, y, z, angle)
    truth = met(own, joints, CAMERA, AHEAD)
    mask = silhouette(own, joints, CAMERA, AHEAD, 0.0)
    assert not (truth & ~mask).any()
    far = silhouette(own, joints, CAMERA, AHEAD, 2.0)
    assert not (mask & ~far).any()
    if x > 0.4:  # wholly in front of the lens: only the rim differs
        near = cv2.dilate(
            met(body(corners=1.05 * CUBE), joints, CAMERA, AHEAD).astype(np.uint8), RIM
        )
        assert not (mask & (near == 0)).any()


@pytest.mark.parametrize(("margin_m", "sigma_rad"), [(0.05, 0.0), (0.0, 0.02)])
def test_the_margin_covers_a_body_that_is_as_far_off_as_it_may_be(margin_m, sigma_rad):
    own, joints = body(margin_m, sigma_rad), at(1.0, 0.0, 1.0)
    mask = silhouette(own, joints, CAMERA, AHEAD, 0.0)
    off = margin_m + 3.0 * sigma_rad * 0.9  # of the nearest corner
    for y, z in ((off, 0.0), (-off, 0.0), (0.0, off), (0.0, -off)):
        moved = met(own, at(1.0, y, 1.0 + z), CAMERA, AHEAD)
        assert moved.any()
        assert not (moved & ~mask).any()
    assert mask.sum() > silhouette(body(), joints, CAMERA, AHEAD, 0.0).sum()


@pytest.mark.parametrize("place", [(-1.0, 0.0, 1.0), (1.0, 5.0, 1.0), (1.0, 0.0, 4.0)])
def test_what_is_behind_or_beside_the_picture_takes_nothing_from_it(place):
    assert not silhouette(body(), at(*place), CAMERA, AHEAD, 1.5).any()


def test_a_limb_that_reaches_through_the_plane_of_the_lens_is_cut_there():
    limb = CUBE * np.array([10.0, 0.5, 0.5])  # from 1 m behind to 1 m ahead, 30 cm below the lens
    own, joints = body(corners=limb), at(0.0, 0.0, 0.7)
    mask = silhouette(own, joints, CAMERA, AHEAD, 0.0)
    truth = met(own, joints, CAMERA, AHEAD)
    assert truth.any()
    assert not (truth & ~mask).any()
    assert not mask[: CAMERA.height // 2].any()


def image(pose):
    z = np.full((CAMERA.height, CAMERA.width), 2.0, np.float32)
    return Depth(z, z * np.float32(0.01), CAMERA, pose)


def test_depth_and_its_deviation_go_together_and_the_rest_keeps_its_bits():
    depth = image(AHEAD)
    found = without_self(depth, body(), at(1.0, 0.0, 1.0), 1.0)
    mask = silhouette(body(), at(1.0, 0.0, 1.0), CAMERA, AHEAD, 1.0)
    assert 0 < mask.sum() < mask.size
    np.testing.assert_array_equal(np.isnan(found.z), mask)
    np.testing.assert_array_equal(np.isnan(found.sigma), mask)
    np.testing.assert_array_equal(found.z[~mask], depth.z[~mask])
    assert not np.isnan(depth.z).any()


def test_without_body_joints_or_place_of_the_camera_nothing_changes():
    depth, joints = image(AHEAD), at(1.0, 0.0, 1.0)
    assert without_self(depth, None, joints, 1.0) is depth
    assert without_self(depth, body(), None, 1.0) is depth
    held = replace(depth, T_body_camera=None)
    assert without_self(held, body(), joints, 1.0) is held
    assert without_self(depth, body(), at(-1.0, 0.0, 1.0), 1.0) is depth


def test_a_picture_shows_the_body_in_black():
    rgb = np.full((CAMERA.height, CAMERA.width, 3), 200, np.uint8)
    view = ColourView(rgb, CAMERA, AHEAD)
    found = blackened(view, body(), at(1.0, 0.0, 1.0)).rgb
    mask = silhouette(body(), at(1.0, 0.0, 1.0), CAMERA, AHEAD, 1.0)
    np.testing.assert_array_equal((found == 0).all(axis=2), mask)
    assert (view.rgb == 200).all()


def test_other_joints_than_the_body_has_are_refused():
    with pytest.raises(InputError, match="2 joint angles; the tree has 1"):
        silhouette(body(), JointReading(Pose3(), (0.0, 0.0)), CAMERA, AHEAD, 0.0)


@pytest.mark.parametrize(
    "lens",
    [
        Camera(188, 120, 114.7, 114.3, 91.5, 61.9, (-0.283, 0.074, 1.9e-4, 1.8e-5, 0.0)),  # EuRoC
        Camera(174, 64, 123.0, 122.6, 86.0, 29.0, (-0.3729, 0.2037, 2.2e-3, 1.4e-3, -0.0723)),  # KITTI
    ],
)  # fmt: skip
@example(0.0625, 0.0, 0.875, 1.0, CUBE * (6.0, 0.5, 0.5))  # a tip between pixels
@example(0.9032268, -0.7425523, 0.58382803, 0.742027, CUBE * (1.0, 8.0, 0.5))  # beside the view
@example(0.4375, 0.28125, 1.0, -1.1875, CUBE * (1.0, 8.0, 0.5))  # its near side behind the lens
@given(
    st.floats(0.02, 1.5), st.floats(-0.8, 0.8), st.floats(0.4, 1.6),
    st.floats(-1.5, 1.5), st.sampled_from([CUBE, CUBE * (1.0, 8.0, 0.5), CUBE * (6.0, 0.5, 0.5)]),
)  # fmt: skip
def test_a_lens_with_distortion_loses_what_the_body_covers_and_little_more(
    lens, x, y, z, angle, corners
):
    own, joints = body(corners=corners), at(x, y, z, angle)
    truth = met(own, joints, lens, AHEAD, NEAR_M)  # what is nearer is not in the picture
    mask = silhouette(own, joints, lens, AHEAD, 0.0)
    assert not (truth & ~mask).any()
    assert beyond_rim(mask, own, joints, lens, AHEAD) == 0


def test_a_chest_below_the_view_is_masked_to_the_pixel_through_a_lens_that_folds():
    lens = Camera(640, 480, 600.0, 600.0, 319.5, 239.5, (-0.30, 0.0, 0.0, 0.0, 0.0))
    chest = np.array([[a, b, c] for a in (-0.05, 0.1) for b in (-0.08, 0.08) for c in (0.2, 0.42)])
    arm = np.array([[a, b, c] for a in (0.0, 0.18) for b in (0.12, 0.18) for c in (0.2, 0.46)])
    for corners, pitch in ((chest, 45), (chest, 30), (arm, 30)):
        eye = Pose3.from_rotation(
            head_rotation(0.0, math.radians(pitch)), np.array([0.02, 0, 0.46])
        )
        own, joints = body(corners=corners), JointReading(Pose3(), (0.0,))
        truth = met(own, joints, lens, eye)
        mask = silhouette(own, joints, lens, eye, 0.0)
        assert truth.any()
        assert not (truth & ~mask).any()
        assert beyond_rim(mask, own, joints, lens, eye) == 0
