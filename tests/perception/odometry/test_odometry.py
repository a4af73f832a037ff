"""RGB-D odometry image by image: trajectory, losses and loop closures."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from perception.depth import structured_light
from perception.odometry.alignment import AlignConfig
from perception.odometry.back_end import BackEnd
from perception.odometry.baselines import ALIGNERS, aligner
from perception.odometry.odometry import (
    FIRST,
    LOST,
    RELOCALISED,
    RESTARTED,
    TRACKED,
    Odometry,
    OdometryConfig,
)
from perception.odometry.place_recognition import describe, motion_between
from perception.odometry.pose_uncertainty import compounded
from perception.odometry.pyramid import Pyramid, build
from perception.primitives.camera import Camera
from perception.primitives.errors import ConfigError
from perception.primitives.frame import DepthView
from perception.primitives.pose import Pose3

CAMERA = Camera(320, 240, 262.0, 262.0, 159.5, 119.5)
SPOTS = np.random.default_rng(3).random((64, 64, 64)) * 180.0 + 40.0


def room(pose: Pose3, rng: np.random.Generator, grey: bool = True) -> Pyramid:
    """A room of 4 x 2.4 x 5 m with a pillar, textured walls, and depth noise."""
    directions = CAMERA.rays @ pose.rotation.T
    z = np.full(directions.shape[:2], np.inf)
    boxes = (
        ((-2.0, -1.2, -2.5), (2.0, 1.2, 2.5), True),
        ((0.3, -1.2, 1.0), (0.7, 1.2, 1.5), False),
    )
    for low, high, inside in boxes:
        with np.errstate(divide="ignore"):
            first = (np.array(low) - pose.position) / directions
            second = (np.array(high) - pose.position) / directions
        near = np.minimum(first, second).max(axis=-1)
        far = np.maximum(first, second).min(axis=-1)
        hit = np.where(inside, far, np.where((near < far) & (near > 0.0), near, np.inf))
        z = np.minimum(z, hit)
    spots = pose.position + directions * z[..., None]
    cells = np.floor(spots / 0.11 + 0.003).astype(int) % 64
    light = SPOTS[cells[..., 0], cells[..., 1], cells[..., 2]]
    z = z + rng.standard_normal(z.shape) * (0.0012 + 0.0019 * (z - 0.4) ** 2)
    depth = structured_light.depth(DepthView(z.astype(np.float32), CAMERA))
    rgb = np.repeat(light[..., None], 3, axis=2).astype(np.uint8)
    return build(depth, rgb if grey else None)


def at(x: float, z: float, turn_deg: float) -> Pose3:
    R = Rotation.from_rotvec([0.0, np.radians(turn_deg), 0.0]).as_matrix()
    return Pose3.from_rotation(R, np.array([x, 0.0, z]))


def off(found: Pose3, true: Pose3) -> float:
    return float(np.linalg.norm(found.position - true.position))


def test_a_trajectory_through_a_room_is_tracked() -> None:
    rng = np.random.default_rng(0)
    poses = [at(0.02 * n, -1.0 + 0.03 * n, 1.5 * n) for n in range(20)]
    odometry = Odometry()
    steps = [odometry.track(room(pose, rng)) for pose in poses]
    assert [step.state for step in steps] == [FIRST] + [TRACKED] * 19
    for step, pose in zip(steps, poses, strict=True):
        assert off(step.T_start_camera, poses[0].inverse() @ pose) < 0.01


def test_the_same_images_give_the_same_bits() -> None:
    runs = []
    for _ in range(2):
        rng, odometry = np.random.default_rng(4), Odometry()
        for n in range(4):
            step = odometry.track(room(at(0.03 * n, -1.0, 2.0 * n), rng))
        runs.append(step.T_start_camera)
    assert runs[0] == runs[1]


def test_a_covered_lens_is_reported_as_lost_and_the_camera_is_relocalised() -> None:
    rng, odometry = np.random.default_rng(1), Odometry()
    for n in range(3):
        odometry.track(room(at(0.03 * n, -1.0, n), rng))
    dark = np.full((240, 320), np.nan, np.float32)
    covered = build(
        structured_light.depth(DepthView(dark, CAMERA)), np.zeros((240, 320, 3), np.uint8)
    )
    assert odometry.track(covered).state == LOST
    assert odometry.losses == 1
    back = odometry.track(room(at(0.08, -1.0, 3.0), rng))
    assert back.state in (TRACKED, RELOCALISED)
    assert off(back.T_start_camera, at(0.0, -1.0, 0.0).inverse() @ at(0.08, -1.0, 3.0)) < 0.03


@pytest.mark.parametrize(
    ("heading_deg", "turn_deg"), [(90.0, 12.0), (90.0, -12.0), (180.0, 12.0), (-90.0, -16.0)]
)
def test_a_fast_turn_before_a_textured_wall_is_no_slide_along_it(
    heading_deg: float, turn_deg: float
) -> None:
    rng, odometry = np.random.default_rng(1), Odometry()
    turned = heading_deg + turn_deg
    poses = [at(0.0, -1.0, heading_deg), at(0.02, -1.0, heading_deg), at(0.04, -1.0, turned)]
    steps = [odometry.track(room(pose, rng)) for pose in poses]
    assert [step.state for step in steps] == [FIRST, TRACKED, TRACKED]
    assert off(steps[-1].T_start_camera, poses[0].inverse() @ poses[-1]) < 0.01


def test_an_image_that_becomes_a_reference_after_a_loss_is_part_of_the_graph() -> None:
    rng = np.random.default_rng(1)
    odometry, back_end = Odometry(), BackEnd(np.random.default_rng(0))
    dark = DepthView(np.full((240, 320), np.nan, np.float32), CAMERA)
    covered = build(structured_light.depth(dark), np.zeros((240, 320, 3), np.uint8))
    first, second, third = (room(at(0.03 * n, -1.0, n), rng) for n in range(3))
    steps = []
    for n, image in enumerate((first, second, covered, third)):
        steps.append(odometry.track(image))
        back_end.take(steps[-1], image, odometry.references[-1].number == n)
    assert [step.state for step in steps] == [FIRST, TRACKED, LOST, TRACKED]
    assert steps[3].reference == 1
    claims = back_end.uncertainty(back_end.solve(), np.zeros((6, 6)))
    assert claims is not None
    before = steps[1].covariance
    whole = compounded(before, steps[1].motion, steps[3].motion, steps[3].covariance)
    np.testing.assert_allclose(claims.from_start[1], before, rtol=1e-3, atol=1e-10)
    np.testing.assert_allclose(claims.from_start[3], whole, rtol=1e-3, atol=1e-10)
    assert np.isnan(claims.from_start[2]).all()


def test_an_image_of_another_place_is_lost() -> None:
    rng, odometry = np.random.default_rng(2), Odometry()
    odometry.track(room(at(0.0, -1.0, 0.0), rng))
    step = odometry.track(room(at(-1.5, 2.0, 160.0), rng))
    assert step.state == LOST
    assert np.sqrt(step.covariance[0, 0]) >= 0.5


def test_after_several_losses_tracking_restarts_and_reports_it() -> None:
    rng, odometry = np.random.default_rng(2), Odometry(OdometryConfig(give_up=3))
    odometry.track(room(at(0.0, -1.0, 0.0), rng))
    states = [odometry.track(room(at(-1.5, 2.0, 160.0 + n), rng)).state for n in range(5)]
    assert states[:3] == [LOST, LOST, RESTARTED]
    assert states[3:] == [TRACKED, TRACKED]


def test_the_number_of_references_is_bounded() -> None:
    rng = np.random.default_rng(6)
    odometry = Odometry(OdometryConfig(keep_m=0.001, remembered=6))
    for n in range(16):
        odometry.track(room(at(0.02 * n, -1.0, 0.5 * n), rng))
        assert len(odometry.references) <= 6
    ready = [one for one in odometry.references if isinstance(one.image, Pyramid)]
    assert len(ready) == 1


def test_a_trajectory_there_and_back_is_closed_at_its_start() -> None:
    rng = np.random.default_rng(7)
    there = [at(0.08 * n, -1.0, 3.0 * n) for n in range(7)]
    poses = [*there, *there[-2::-1]]
    odometry, back_end = Odometry(), BackEnd(np.random.default_rng(0))
    for n, pose in enumerate(poses):
        image = room(pose, rng)
        step = odometry.track(image)
        back_end.take(step, image, odometry.references[-1].number == n)
    solution = back_end.solve()
    assert solution is not None
    found = back_end.trajectory(solution)
    gap = found[0].inverse() @ found[-1]
    assert off(gap, Pose3()) < 0.02
    assert np.degrees(Rotation.from_matrix(gap.rotation).magnitude()) < 0.4
    for pose, truth in zip(found, poses, strict=True):
        assert off(found[0].inverse() @ pose, poses[0].inverse() @ truth) < 0.03


@pytest.mark.parametrize("grey", [True, False])
def test_a_place_is_recognised_by_its_features(grey: bool) -> None:
    rng = np.random.default_rng(8)
    one, other = at(0.0, 0.0, 0.0), at(0.15, 0.1, 9.0)
    first, second = (describe(n, room(pose, rng, grey)) for n, pose in enumerate((one, other)))
    found = motion_between(first, second, np.random.default_rng(0))
    if not grey and found is None:
        return  # bare walls have few features in depth; only a wrong motion would be an error
    assert found is not None
    assert off(found, one.inverse() @ other) < 0.06


def test_different_places_are_not_matched() -> None:
    rng = np.random.default_rng(9)
    first, second = (
        describe(n, room(pose, rng)) for n, pose in enumerate((at(0, 0, 0), at(0, 0, 180)))
    )
    assert motion_between(first, second, np.random.default_rng(0)) is None


@pytest.mark.parametrize("name", ALIGNERS)
def test_baselines_agree_with_our_alignment(name: str) -> None:
    pytest.importorskip("small_gicp")
    rng = np.random.default_rng(10)
    one, other = at(0.0, -1.0, 0.0), at(0.02, -0.98, 1.0)
    found = aligner(name)(room(one, rng), room(other, rng), [Pose3()], AlignConfig())
    assert found is not None
    assert off(found.motion, one.inverse() @ other) < 0.02
    assert found.fitting > 0.8


def test_an_unknown_aligner_is_refused() -> None:
    with pytest.raises(ConfigError, match="aligner"):
        aligner("orb")


def test_a_real_living_room_is_tracked_to_five_millimetres(recordings: Path) -> None:
    reader = pytest.importorskip("surefoot.recordings.open", reason="reads a recording")
    odometry, found, true = Odometry(), [], []
    for number, frame in enumerate(
        reader.open_recording(recordings / "redwood_livingroom").frames()
    ):
        assert frame.depth is not None
        assert frame.colour is not None
        assert frame.T_world_camera is not None
        step = odometry.track(build(structured_light.depth(frame.depth), frame.colour.rgb))
        assert step.state == (TRACKED if number else FIRST)
        found.append(step.T_start_camera)
        true.append(frame.T_world_camera)
    for pose, truth in zip(found, true, strict=True):
        assert off(pose, true[0].inverse() @ truth) < 0.005
