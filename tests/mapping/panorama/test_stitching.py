"""The panorama against the ground truth of simulated rooms and of a real kitchen."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation

from mapping.panorama.key_angles import laws
from mapping.panorama.pairs import PairConfig
from mapping.panorama.sphere import direction
from mapping.panorama.stitching import StitchConfig, place, stitch
from mapping.panorama.views import PriorConfig, View
from perception.features.mdghm_sift import SiftConfig
from perception.primitives.camera import Camera
from perception.primitives.frame import Depth


def rms_deg(rotations, true):
    between = Rotation.from_matrix(
        np.array([a @ b.T for a, b in zip(rotations, true, strict=True)])
    )
    return np.degrees(np.sqrt(np.mean((between.mean().inv() * between).magnitude() ** 2)))


def rotations(placed):
    return [p.T_base_camera.rotation for p in placed]


@pytest.mark.parametrize("moving", [False, True])
def test_no_views_are_an_empty_panorama(moving):
    found = stitch([], np.random.default_rng(0), StitchConfig(moving=moving))
    assert found.placed == []
    assert found.drawing is None


@pytest.mark.parametrize(("scene", "seed"), [("boxes", 0), ("home", 0), ("corridor", 1)])
def test_stitching_corrects_encoder_errors_of_half_a_degree(placed_round, scene, seed):
    views, true, (placed, _, _) = placed_round(scene, seed)
    truth = [pose.rotation for pose in true]
    assert rms_deg([v.prior.rotation for v in views], truth) > 0.45
    assert rms_deg(rotations(placed), truth) <= 0.3


def test_rotation_errors_are_consistent_with_their_covariances(placed_round):
    squares, count = 0.0, 0
    for seed in range(3):
        _, true, (placed, _, _) = placed_round("boxes", seed)
        for p, t in zip(placed, true, strict=True):
            error = Rotation.from_matrix(p.T_base_camera.rotation.T @ t.rotation).as_rotvec()
            squares += float(error @ np.linalg.solve(p.covariance[:3, :3], error))
            count += 1
    # the errors within a panorama are correlated: three panoramas count as about nine numbers
    low, high = stats.chi2.ppf([0.005, 0.995], 9) / 3
    assert low < squares / count < high


def test_known_motion_between_views_is_compensated(look_round):
    views, true = look_round("boxes", 1, 0.5, walk_m=0.03)
    placed, _, _ = place(views, np.random.default_rng(0), StitchConfig())
    assert rms_deg(rotations(placed), [pose.rotation for pose in true]) <= 0.3


def test_views_without_matches_keep_the_encoders(look_round):
    views, _ = look_round("boxes", 0, 0.5)
    empty = [
        View(
            Depth(np.full_like(v.depth.z, np.nan), v.depth.sigma, v.depth.camera),
            tuple(np.full_like(p, 90) for p in v.pictures),
            v.prior,
        )
        for v in views
    ]
    placed, links, _ = place(empty, np.random.default_rng(0), StitchConfig())
    assert links == []
    for p, v in zip(placed, views, strict=True):
        assert p.by == "encoders"
        assert p.links == 0
        np.testing.assert_allclose(p.T_base_camera.rotation, v.prior.rotation, atol=1e-9)


def test_features_alone_are_not_much_worse_than_the_encoders(look_round):
    views, true = look_round("home", 1, 0.5)
    placed, _, _ = place(views, np.random.default_rng(0), StitchConfig(surfaces=False))
    truth = [pose.rotation for pose in true]
    assert rms_deg(rotations(placed), truth) <= 1.1 * rms_deg(
        [v.prior.rotation for v in views], truth
    )
    assert {p.by for p in placed} <= {"features", "encoders"}


def test_features_and_surfaces_both_link_a_pair(look_round):
    views, _ = look_round("home", 1, 0.5)
    links = place(views, np.random.default_rng(0), StitchConfig()).links
    pairs = {
        kind: {(link.first, link.second) for link in links if link.by == kind}
        for kind in ("features", "surfaces")
    }
    assert pairs["features"] & pairs["surfaces"]


def test_features_hold_views_whose_surfaces_cannot_be_aligned(look_round):
    """With points but no normals, as of scattered depth: the links of features alone determine the graph."""
    views, true = look_round("home", 1, 2.0)
    scattered = []
    for view in views:
        z = np.full_like(view.depth.z, np.nan)
        z[::7, ::7] = view.depth.z[::7, ::7]
        scattered.append(replace(view, depth=replace(view.depth, z=z)))
    config = StitchConfig(prior=PriorConfig(pan_deg=2.0, tilt_deg=2.0))
    placed, links, _ = place(scattered, np.random.default_rng(0), config)
    truth = [pose.rotation for pose in true]
    before = rms_deg([v.prior.rotation for v in views], truth)
    assert {link.by for link in links} == {"features"}
    assert rms_deg(rotations(placed), truth) < 0.75 * before


def test_a_view_without_prior_and_matches_is_left_out(look_round):
    views, _ = look_round("boxes", 0, 0.0)
    blind = views[3].depth
    alone = View(
        Depth(np.full_like(blind.z, np.nan), blind.sigma, blind.camera),
        (np.full_like(views[3].pictures[0], 90),),
    )
    placed, _, _ = place([views[0], alone], np.random.default_rng(0), StitchConfig())
    assert placed[0] is not None
    assert placed[1] is None


def test_the_panorama_agrees_with_the_room(look_round):
    views, true = look_round("boxes", 2, 0.5)
    panorama = stitch(views, np.random.default_rng(0))
    drawing = panorama.drawing
    assert np.degrees(drawing.sphere.width / drawing.sphere.px_per_rad) == pytest.approx(164, abs=6)
    assert np.degrees(drawing.sphere.height / drawing.sphere.px_per_rad) == pytest.approx(70, abs=6)
    xyz, sigma = drawing.points()
    off = []
    for pose, view in zip(true, views, strict=True):  # centre of each image
        z = view.depth.z[60:84, 70:106]
        seen = pose.apply(view.depth.camera.rays[60:84, 70:106] * z[..., None]).reshape(-1, 3)
        seen = seen[np.isfinite(seen).all(axis=1)][::60]
        off += [np.linalg.norm(xyz - point, axis=1).min() for point in seen]
    assert np.median(off) < 0.015
    assert np.all(sigma > 0.0)
    assert np.nanmax(drawing.stamp_s) == 8.0


def test_key_angles_are_linear_to_half_a_degree(look_round):
    views, _ = look_round("boxes", 0, 0.5)
    panorama = stitch(views, np.random.default_rng(0))
    theta, phi = laws(panorama.drawing, views)
    np.testing.assert_allclose(np.degrees(theta.keys_rad), [-60, -30, 0, 30, 60], atol=1e-6)
    np.testing.assert_allclose(np.degrees(phi.keys_rad), [-17, 0, 17], atol=1e-6)
    sphere = panorama.drawing.sphere
    x, y = np.arange(sphere.width) * 1.0, np.arange(sphere.height) * 1.0
    exact = sphere.angles(x, np.zeros_like(x))[0]
    assert np.degrees(np.sqrt(np.mean((theta.angle(x) - exact) ** 2))) <= 1.0
    exact = sphere.angles(np.zeros_like(y), y)[1]
    assert np.degrees(np.sqrt(np.mean((phi.angle(y) - exact) ** 2))) <= 1.0
    assert direction(theta.angle(x[:1]), phi.angle(y[:1])).shape == (1, 3)


def test_the_same_random_numbers_give_the_same_panorama(placed_round):
    views, _, (one, _, _) = placed_round("corridor", 1)
    other, _, _ = place(views, np.random.default_rng(0), StitchConfig())
    for a, b in zip(one, other, strict=True):
        assert a.T_base_camera == b.T_base_camera


def test_a_real_kitchen_is_stitched_without_encoders(recordings):
    folder = recordings / "sevenscenes_redkitchen" / "pan"
    camera = Camera(640, 480, 585.0, 585.0, 320.0, 240.0)
    views, true = [], []
    for name in sorted(folder.glob("*.depth.png"))[::6]:
        raw = cv2.imread(str(name), cv2.IMREAD_UNCHANGED).astype(np.float32)
        z = np.where((raw > 0) & (raw < 65535), raw / np.float32(1000), np.float32(np.nan))
        sigma = (0.0012 + 0.0019 * (z - 0.4) ** 2).astype(np.float32)
        grey = cv2.imread(str(name).replace("depth.png", "color.jpg"), 0)
        views.append(View(Depth(z, sigma, camera), (grey,)))
        true.append(np.loadtxt(str(name).replace("depth.png", "pose.txt"))[:3, :3])
    pairs = PairConfig(sift=SiftConfig(upsample=False), travel_m=0.05)
    still = StitchConfig(pairs=pairs)
    placed, links, _ = place(views, np.random.default_rng(0), still)
    assert rms_deg(rotations(placed), true) <= 1.8  # seven of the forty views
    assert all(link.inliers > 8.0 + 0.3 * link.matches for link in links)
    placed, _, _ = place(views, np.random.default_rng(0), replace(still, moving=True))
    assert rms_deg(rotations(placed), true) <= 0.9
