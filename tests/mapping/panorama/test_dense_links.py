"""Views that features do not connect: aligned as whole images, against the true poses of real and closed-form motions."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mapping.panorama.adjustment import largest_set, linked_sets
from mapping.panorama.dense_links import DenseViews, _agree, connect, stiffened
from mapping.panorama.pairs import Link
from mapping.panorama.stitching import StitchConfig, place
from mapping.panorama.views import view_of_depth
from perception.depth.structured_light import depth as structured_light
from perception.odometry.alignment import Alignment
from perception.primitives.camera import Camera
from perception.primitives.frame import DepthView
from perception.primitives.pose import Pose3

KITCHEN = Camera(640, 480, 585.0, 585.0, 320.0, 240.0)
XTION = Camera(640, 480, 535.4, 539.2, 320.1, 247.6)


def bare_view(path, camera, per_metre, rng=None):
    """A depth image without colour; with `rng`, 40 % of it are holes."""
    raw = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    z = np.where((raw == 0) | (raw == 65535), np.nan, raw / per_metre).astype(np.float32)
    if rng is not None:
        relief = cv2.resize(
            rng.standard_normal((12, 16)), (640, 480), interpolation=cv2.INTER_CUBIC
        )
        z[relief < np.quantile(relief, 0.4)] = np.nan
    return view_of_depth(structured_light(DepthView(z, camera)), 5.0)


@pytest.fixture(scope="module")
def pan(recordings):
    """Every eighth view of a pan by hand, with holes, and the given poses."""
    rng = np.random.default_rng(0)
    paths = sorted((recordings / "sevenscenes_redkitchen" / "pan").glob("*.depth.png"))[::8]
    views = [bare_view(path, KITCHEN, 1000.0, rng) for path in paths]
    poses = [np.loadtxt(str(path).replace("depth.png", "pose.txt")) for path in paths]
    return views, [Pose3.from_matrix(pose) for pose in poses]


def error_deg(found, true):
    return np.degrees(Rotation.from_matrix(found.rotation.T @ true.rotation).magnitude())


def test_views_with_holes_and_without_colour_are_placed_by_their_surfaces(pan):
    views, true = pan
    placed, _, reasons = place(views, np.random.default_rng(0), StitchConfig(moving=True))
    assert reasons == {}
    assert {one.by for one in placed} == {"alignment"}
    first = placed[0].T_base_camera.inverse()
    for one, pose in zip(placed, true, strict=True):
        between, known = first @ one.T_base_camera, true[0].inverse() @ pose
        assert error_deg(between, known) < 2.5
        assert np.linalg.norm(between.position - known.position) < 0.06


def test_two_directions_agree_as_often_as_their_covariances_say_also_over_a_lever():
    """In 999 of 1000 pairs whose errors are those of their covariances, with 0.85 m between the views."""
    rng = np.random.default_rng(0)
    turn = Rotation.from_euler("y", 0.3).as_matrix()
    there = Pose3.from_rotation(turn, np.array([0.8, 0.0, 0.3]))
    covariance = np.diag([0.002**2] * 3 + [0.004**2] * 3)

    def measured(motion):
        off = rng.multivariate_normal(np.zeros(6), covariance)
        turned = Rotation.from_rotvec(off[3:]).as_matrix() @ motion.rotation
        found = Pose3.from_rotation(turned, motion.position + off[:3])
        return Alignment(found, covariance, 1.0, 1.0, 0.0, 0.0)

    pairs = [(measured(there), measured(there.inverse())) for _ in range(2000)]
    accepted = sum(_agree(one, other, np.zeros((6, 6))) for one, other in pairs)
    assert 1993 <= accepted <= 2000  # 1998 +- 1.4


def test_a_link_has_the_covariance_of_its_error_in_its_own_axes(pan):
    views, true = pan
    images = DenseViews(views, np.random.default_rng(0))
    squares = []
    for first, second in ((0, 1), (1, 2), (2, 3), (3, 4), (0, 2), (1, 3), (2, 4)):
        link = images.align(first, second).link
        error = link.T_first_second.inverse() @ true[first].inverse() @ true[second]
        off = np.concatenate([Rotation.from_matrix(error.rotation).as_rotvec(), error.position])
        squares.append(off @ np.linalg.solve(link.covariance, off) / 6.0)
    assert 0.2 < np.mean(squares) < 2.0  # given poses are themselves good to 1 cm


def test_views_of_another_room_are_left_out_with_the_reason(pan, recordings):
    views, _ = pan
    other = recordings / "tum_fr3_cabinet" / "depth"
    views = [*views[:3], *(bare_view(other / f"00{n}.png", XTION, 5000.0) for n in ("00", "01"))]
    links, reasons = connect(DenseViews(views, np.random.default_rng(0)), [], len(views))
    assert largest_set(linked_sets(links, len(views))) == {0, 1, 2}
    assert set(reasons) == {3, 4}
    assert all("nearest in time is view" in reason for reason in reasons.values())


def test_a_chain_is_stiffened_only_by_links_near_its_poses(pan):
    views, true = pan
    images = DenseViews(views, np.random.default_rng(0))
    chain = [images.align(k, k + 1).link for k in range(3)]
    poses = [true[0].inverse() @ pose for pose in true[:4]]
    more = stiffened(images, chain, poses)
    assert len(more) > 3
    for link in more:
        known = true[link.first].inverse() @ true[link.second]
        assert error_deg(link.T_first_second, known) < 2.5
    turned = Pose3.from_rotation(Rotation.from_euler("y", 0.8).as_matrix(), np.zeros(3))
    false = [poses[0], poses[1], turned, turned @ turned]
    assert len(stiffened(images, chain, false)) < len(more)


def test_a_link_that_depth_contradicts_is_recognised(pan):
    views, true = pan
    images = DenseViews(views, np.random.default_rng(0))
    known = true[0].inverse() @ true[1]
    assert not images.contradicts(Link(0, 1, known, np.eye(6), 20, 30))
    for step_m in (
        -0.5,
        0.5,
    ):  # one view's points are in front of the other's surfaces, or behind them
        wrong = Pose3((0.0, 0.0, step_m)) @ known
        assert images.contradicts(Link(0, 1, wrong, np.eye(6), 20, 30))


def test_the_largest_linked_set_is_found_and_of_equal_ones_the_first():
    def link(first, second):
        return Link(first, second, Pose3(), np.eye(6), 0, 0)

    assert linked_sets([link(3, 4), link(1, 3)], 5) == [0, 1, 2, 1, 1]
    assert largest_set(linked_sets([link(3, 4), link(1, 3)], 5)) == {1, 3, 4}
    assert largest_set(linked_sets([link(0, 2), link(1, 3)], 4)) == {0, 2}
    assert largest_set([0]) == {0}
