"""Sessions of one place: their links, and the joint graph, against the motion they were rendered with."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from perception.depth import structured_light
from perception.odometry.alignment import align
from perception.odometry.moved_volumes import MovedVolume, compared_images, moved_volumes
from perception.odometry.place_recognition import PlacesConfig, describe, for_any_camera
from perception.odometry.pose_uncertainty import AttachedImage, pose_uncertainty
from perception.odometry.pyramid import Pyramid, build
from perception.odometry.session_graph import (
    BELIEVED,
    SessionGraph,
    groups,
    join,
    relative_covariance,
)
from perception.odometry.session_links import (
    PairLinks,
    Session,
    View,
    between,
    link_sessions,
    place_probability,
)
from perception.primitives.camera import Camera
from perception.primitives.frame import DepthView
from perception.primitives.pose import Pose3
from perception.smoothing.factors import LoopClosure, Motion

CAMERA = Camera(320, 240, 262.0, 262.0, 159.5, 119.5)
STEP = np.diag([0.002**2] * 3 + [0.001**2] * 3)
HOME = (((-2.0, -1.2, -2.5), (2.0, 1.2, 2.5)), ((0.3, -1.2, 1.0), (0.7, 1.2, 1.5)))
OTHER = (((-1.6, -1.2, -3.0), (2.4, 1.2, 2.0)), ((-0.9, -0.2, 0.8), (-0.2, 1.2, 1.3)))


def image(
    room: tuple, paint: int, pose: Pose3, rng: np.random.Generator, camera: Camera = CAMERA
) -> Pyramid:
    """A room with blocks in it, patterned walls (paint 0: no colour), and depth noise."""
    spots = np.random.default_rng(paint).random((64, 64, 64)) * 180.0 + 40.0
    directions = camera.rays @ pose.rotation.T
    z = np.full(directions.shape[:2], np.inf)
    for number, (low, high) in enumerate(room):
        with np.errstate(divide="ignore"):
            first = (np.array(low) - pose.position) / directions
            second = (np.array(high) - pose.position) / directions
        near = np.minimum(first, second).max(axis=-1)
        far = np.maximum(first, second).min(axis=-1)
        z = np.minimum(
            z, far if number == 0 else np.where((near < far) & (near > 0.0), near, np.inf)
        )
    at = np.floor((pose.position + directions * z[..., None]) / 0.11 + 0.003).astype(int) % 64
    light = spots[at[..., 0], at[..., 1], at[..., 2]]
    z = z + rng.standard_normal(z.shape) * (0.0012 + 0.0019 * (z - 0.4) ** 2)
    depth = structured_light.depth(DepthView(z.astype(np.float32), camera))
    if paint == 0:
        return build(depth)
    return build(depth, np.repeat(light[..., None], 3, axis=2).astype(np.uint8))


def moved(x: float, z: float, turn_deg: float) -> Pose3:
    R = Rotation.from_rotvec([0.0, np.radians(turn_deg), 0.0]).as_matrix()
    return Pose3.from_rotation(R, np.array([x, 0.0, z]))


def path(begin: int) -> list[Pose3]:
    return [moved(0.03 * n - 0.4, -1.3 + 0.05 * n, 2.5 * n) for n in range(begin, begin + 7)]


def session(
    room: tuple,
    paint: int,
    poses: list[Pose3],
    T_session_world: Pose3,
    seed: int,
    camera: Camera = CAMERA,
) -> tuple[Session, SessionGraph]:
    """Its images in axes of its own, whose odometry has the noise of `STEP`."""
    rng = np.random.default_rng(seed)
    own = [T_session_world @ poses[0]]
    factors = []
    for k in range(1, len(poses)):
        e = rng.multivariate_normal(np.zeros(6), STEP)
        noise = Pose3.from_rotation(Rotation.from_rotvec(e[3:]).as_matrix(), e[:3])
        motion = noise @ (poses[k - 1].inverse() @ poses[k])
        own.append(own[-1] @ motion)
        factors.append(Motion(k - 1, k, motion, STEP))
    seen = [image(room, paint, pose, rng, camera) for pose in poses]
    views = [
        View(describe(k, one, for_any_camera(PlacesConfig(), one)), where)
        for k, (one, where) in enumerate(zip(seen, own, strict=True))
    ]
    return Session(views), SessionGraph(own, factors)


@pytest.fixture(scope="module")
def three():
    """Two sessions of one room with axes apart, and one of another."""
    return (
        session(HOME, 3, path(0), Pose3(), 1),
        session(HOME, 3, path(4), moved(5.0, -2.0, 70.0), 2),
        session(OTHER, 9, path(2), moved(-1.0, 4.0, -30.0), 3),
    )


@pytest.fixture(scope="module")
def pairs(three):
    return {
        (i, j): link_sessions(three[i][0], three[j][0], np.random.default_rng(0))
        for i, j in ((0, 1), (0, 2), (1, 2))
    }


def test_sessions_of_one_room_are_linked_at_the_true_motion(three, pairs):
    found = pairs[0, 1]
    assert found.probability > 0.99
    assert found.views >= 3
    true = moved(5.0, -2.0, 70.0).inverse()
    for link in found.links:
        off = true.inverse() @ between(three[0][0], three[1][0], link)
        at_camera = off @ three[1][0].pose(link.after)
        assert np.linalg.norm(at_camera.position - three[1][0].pose(link.after).position) < 0.03


def test_another_room_is_not_believed(pairs):
    assert pairs[0, 2].probability < 0.01
    assert pairs[1, 2].probability < 0.01


def test_the_joint_poses_lie_within_their_covariance(three, pairs):
    joined = join([graph for _, graph in three], pairs, [0, 1, 2])
    assert [sorted(part.sessions) for part in joined] == [[0, 1], [2]]
    part = joined[0]
    every = [pose for k in part.sessions for pose in part.poses[k]]
    true = [*path(0), *path(4)]
    images = [AttachedImage(pose, k, np.zeros((6, 6))) for k, pose in enumerate(every)]
    claims = pose_uncertainty(part.factors, dict(enumerate(every)), images)
    errors = []
    for k in range(7, 14):  # the second session, in the axes of the first
        difference = every[k].position - true[k].position
        P = claims.from_start[k][:3, :3]
        errors.append(float(difference @ np.linalg.solve(P, difference)) / 3.0)
        assert np.linalg.norm(difference) < 0.02
    assert np.mean(errors) < 4.0  # twice the claimed deviation


def test_the_axes_are_those_of_the_session_with_the_lowest_rank(three, pairs):
    graphs = [graph for _, graph in three]
    part = join(graphs, pairs, [1, 0, 2])[0]
    assert part.sessions == (1, 0)
    np.testing.assert_allclose(part.poses[1][0].matrix, graphs[1].poses[0].matrix, atol=1e-3)


def test_a_pair_that_contradicts_the_others_is_no_longer_believed(three, pairs):
    """The true links join 0 and 1; a false motion between 1 and a copy of 0 contradicts 0 and the copy."""
    graphs = [three[0][1], three[1][1], three[0][1]]
    same = tuple(
        replace(pairs[0, 1].links[0], before=k, after=k, motion=Pose3(), covariance=STEP)
        for k in range(6)
    )
    false = tuple(
        replace(
            link,
            before=link.after,
            after=link.before,
            motion=moved(0.5, 0.5, 40.0) @ link.motion.inverse(),
        )
        for link in pairs[0, 1].links
    )
    believed = {
        (0, 1): pairs[0, 1],
        (0, 2): PairLinks(same, 0.9999, 6, 6, 1.0, 0.0),
        (1, 2): PairLinks(false, 0.95, 6, 6, 1.0, 0.0),
    }
    part = join(graphs, believed, [0, 1, 2])[0]
    assert sorted(part.sessions) == [0, 1, 2]
    assert set(part.links) == {(0, 1), (0, 2)}
    for one, other in zip(part.poses[0], part.poses[2], strict=True):
        assert np.linalg.norm(one.position - other.position) < 0.01


FIRST_BOX = ((-1.4, -0.1, 0.6), (-0.8, 1.2, 1.2))
MOVED_BOX = ((-0.75, -0.1, 0.7), (-0.15, 1.2, 1.3))


def test_a_box_that_was_moved_does_not_separate_the_sessions_of_a_room():
    first, _ = session((*HOME, FIRST_BOX), 3, [*path(-4), *path(3)], Pose3(), 1)
    second, _ = session((*HOME, MOVED_BOX), 3, [*path(-3), *path(4)], moved(5.0, -2.0, 70.0), 2)
    found = link_sessions(first, second, np.random.default_rng(0))
    assert found.probability >= BELIEVED
    assert found.moved == 2  # the place that it left, and the one that it filled


def volumes(first: tuple, second: tuple) -> list[MovedVolume]:
    """Of two images from one place."""
    rng = np.random.default_rng(0)
    images = [image(room, 3, path(2)[0], rng) for room in (first, second)]
    return moved_volumes([compared_images(*images, moved(1.0, 2.0, 30.0), Pose3(), 0.7)])


def covered(box: tuple) -> float:
    """Share of the pixels that a box covers, by rays."""
    directions = CAMERA.rays @ path(2)[0].rotation.T
    low, high = ((np.array(corner) - path(2)[0].position) / directions for corner in box)
    return float(np.mean(np.minimum(low, high).max(axis=-1) < np.maximum(low, high).min(axis=-1)))


def test_a_moved_box_is_one_volume_that_contradicts_and_one_that_hides():
    found = volumes((*HOME, FIRST_BOX), (*HOME, MOVED_BOX))
    large = [one for one in found if one.contradicting + one.hidden > 0.01]
    assert len(large) == 2
    # depth at the edges of a box is missing
    new, old = covered(MOVED_BOX), covered(FIRST_BOX)
    assert 0.7 * new < max(one.contradicting for one in large) < new
    assert 0.7 * old < max(one.hidden for one in large) < old


def test_a_wall_that_only_one_session_has_is_no_furniture():
    assert volumes(HOME, (*HOME, ((-1.9, -1.2, 0.6), (0.2, 1.2, 0.7)))) == []


def test_groups_are_connected_and_the_largest_comes_first():
    assert groups(5, {(1, 4), (3, 4)}) == [[1, 3, 4], [0], [2]]
    assert groups(2, set()) == [[0], [1]]


@pytest.mark.parametrize(
    ("one", "other"), [((6, 0.9, 0.02), (2, 0.9, 0.02)), ((6, 0.9, 0.02), (6, 0.7, 0.02)), ((6, 0.9, 0.02), (6, 0.9, 0.2)), ((6, 0.9, 0.02), (6, 0.9, 0.02, 3))]
)  # fmt: skip
def test_less_evidence_gives_a_smaller_probability(one, other):
    assert place_probability(*one) > place_probability(*other)
    assert place_probability(*one) > BELIEVED


def test_free_space_speaks_against_a_place_whatever_fits():
    assert place_probability(100, 1.0, 0.35) < 0.5


def test_the_covariance_of_a_motion_is_what_the_path_adds():
    one, other = moved(0.0, 0.0, 0.0), moved(0.0, 1.0, 30.0)
    before = np.diag([0.01**2] * 3 + [0.02**2] * 3)
    lever = np.eye(6)
    arm = other.position - one.position
    lever[:3, 3:] = -np.array([[0, -arm[2], arm[1]], [arm[2], 0, -arm[0]], [-arm[1], arm[0], 0]])
    added = np.diag([0.03**2] * 3 + [0.01**2] * 3)
    found = relative_covariance(before, lever @ before @ lever.T + added, one, other)
    np.testing.assert_allclose(found, added, atol=1e-12)
    least = relative_covariance(before, before, one, one)
    assert np.linalg.eigvalsh(least)[0] > 0.0


def test_the_same_sessions_give_the_same_links(three, pairs):
    again = link_sessions(three[0][0], three[1][0], np.random.default_rng(0))
    assert [one.motion for one in again.links] == [one.motion for one in pairs[0, 1].links]


def test_a_session_that_shows_nothing_is_linked_with_nothing(three):
    z = np.full((240, 320), np.nan, np.float32)
    blank = describe(0, build(structured_light.depth(DepthView(z, CAMERA))))
    nothing = Session([View(blank, Pose3())])
    for pair in ((nothing, three[0][0]), (three[0][0], nothing)):
        found = link_sessions(*pair, np.random.default_rng(0))
        assert found.links == ()
        assert math.isnan(found.probability)  # not 0: it is not known
        assert "too few features" in found.reason


def test_closures_of_a_session_are_kept(three):
    graph = three[0][1]
    closed = LoopClosure(0, 6, path(0)[0].inverse() @ path(0)[6], STEP)
    part = join([SessionGraph(graph.poses, [*graph.factors, closed])], {}, [0])[0]
    assert len(part.factors) == 7


COARSE = Camera(96, 72, 80.0, 80.0, 47.5, 35.5)


@pytest.mark.parametrize("swapped", [False, True])
def test_a_coarse_camera_is_linked_with_a_fine_one_in_its_room_alone(three, swapped):
    coarse, _ = session(HOME, 3, path(4), moved(5.0, -2.0, 70.0), 2, COARSE)
    for other, related in ((three[0][0], True), (three[2][0], False)):
        pair = (coarse, other) if swapped else (other, coarse)
        found = link_sessions(*pair, np.random.default_rng(0))
        assert found.probability > 0.99 if related else found.probability < 0.01


FURNISHED = (
    HOME[0],
    *(((x, y, z), (x + 0.3, 1.2, z + 0.3)) for x, y, z in (
        (-1.4, 0.2, 1.0), (-0.8, -0.3, 1.9), (-0.2, 0.5, 0.9), (0.3, -0.6, 1.6), (0.9, 0.3, 1.2), (1.4, -0.2, 0.6),
    )),
)  # fmt: skip


def test_a_camera_with_colour_is_linked_with_one_without():
    rich, _ = session(FURNISHED, 3, path(0), Pose3(), 1)
    bare, _ = session(FURNISHED, 0, path(2), moved(5.0, -2.0, 70.0), 2)
    for pair in ((rich, bare), (bare, rich)):
        assert link_sessions(*pair, np.random.default_rng(0)).probability > 0.99


def test_without_colour_another_room_is_not_compared():
    rich, _ = session(FURNISHED, 3, path(0), Pose3(), 1)
    bare, _ = session(OTHER, 0, path(2), moved(5.0, -2.0, 70.0), 2)
    found = link_sessions(rich, bare, np.random.default_rng(0))
    assert found.links == ()
    assert math.isnan(found.probability)
    assert found.reason


def test_an_image_with_fewer_levels_is_aligned():
    rng = np.random.default_rng(0)
    low = image(HOME, 3, Pose3(), rng, Camera(96, 60, 80.0, 80.0, 47.5, 29.5))
    true = moved(0.05, 0.03, 2.0)
    high = image(HOME, 3, true, rng)
    assert len(low.levels) < len(high.levels)
    for target, source, motion in ((low, high, true), (high, low, true.inverse())):
        found = align(target, source)
        assert found is not None
        assert np.linalg.norm(found.motion.position - motion.position) < 0.01
