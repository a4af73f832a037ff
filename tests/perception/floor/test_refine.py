"""The fit in inverse depth: exact without noise, covariance by Monte Carlo, fusion with a prior."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from perception.depth.distortion import Distortion, DistortionConfig
from perception.depth.points import Points
from perception.floor import _fit_kernels as kernels
from perception.floor.refine import RefineConfig, fuse, mixed, refine
from perception.floor.sample import PENALTY, SHARP, Sample, ScoreConfig, score
from perception.primitives.errors import ConfigError
from perception.primitives.plane import Plane

EXACT = RefineConfig(rough_m=0.0)
WIDE = dataclasses.replace(EXACT, wide_sigmas=60.0, narrow_sigmas=50.0, foot_m=0.0)


def patch(rng, normal, height, count=3000):
    """Points of a plane seen in random directions ahead, camera frame."""
    rays = np.column_stack([rng.uniform(-0.5, 0.5, (count, 2)), np.ones(count)])
    rays[:, 1] += 0.45
    z = -height / (rays @ normal)
    return rays * z[:, None]


@settings(max_examples=25, deadline=None)
@given(st.floats(-0.15, 0.15), st.floats(-0.15, 0.15), st.floats(0.2, 1.6))
def test_noise_free_points_give_their_plane(roll, pitch, height):
    normal = np.array([roll, -1.0, pitch - 0.2])
    normal /= np.linalg.norm(normal)
    xyz = patch(np.random.default_rng(0), normal, height)
    points = Points(xyz, np.full(len(xyz), 0.004), np.arange(len(xyz)))
    off = normal + np.array([0.003, 0.0, 0.003])
    start = Plane(off / np.linalg.norm(off), height + 0.003)
    plane = refine(points, start, ScoreConfig(), EXACT).plane
    np.testing.assert_allclose(plane.normal, normal, atol=1e-9)
    assert abs(plane.offset_m - height) < 1e-9


def test_the_covariance_equals_that_of_many_repetitions():
    normal = np.array([0.05, -0.9, -0.4])
    normal /= np.linalg.norm(normal)
    truth = Plane(normal, 0.4)
    rng = np.random.default_rng(1)
    xyz = patch(rng, normal, 0.4, 800)
    errors, claims = [], []
    for _ in range(300):
        z = xyz[:, 2] + 0.01 * rng.normal(size=len(xyz))
        points = Points(xyz * (z / xyz[:, 2])[:, None], np.full(len(xyz), 0.01), np.arange(len(z)))
        plane = refine(points, truth, ScoreConfig(), EXACT).plane
        errors.append(plane.error_to(truth))
        claims.append(plane.covariance)
    seen, claimed = np.cov(np.array(errors).T), np.mean(claims, axis=0)
    ratio = np.sqrt(np.diag(seen) / np.diag(claimed))
    assert np.all((ratio > 0.85) & (ratio < 1.2))  # the noise factor only ever widens


def test_noise_correlated_between_neighbours_widens_the_covariance():
    rng = np.random.default_rng(2)
    normal = np.array([0.0, -0.9, -0.436])
    normal /= np.linalg.norm(normal)
    xyz = patch(rng, normal, 0.4, 20000)
    cell = np.floor(xyz[:, :2] / xyz[:, 2:] * 12.0).astype(int)
    patches = rng.normal(size=(200, 200))[cell[:, 0], cell[:, 1]]
    widths = []
    for noise in (rng.normal(size=len(xyz)), patches):
        z = xyz[:, 2] + 0.005 * noise
        points = Points(xyz * (z / xyz[:, 2])[:, None], np.full(len(xyz), 0.005), np.arange(len(z)))
        fit = refine(points, Plane(normal, 0.4), ScoreConfig(), EXACT)
        widths.append(float(np.trace(fit.plane.covariance)))
    assert widths[1] > 20.0 * widths[0]  # about 60 points share each patch


def test_an_error_of_depth_scale_is_within_the_covariance():
    normal = np.array([0.0, -0.9, -0.436])
    normal /= np.linalg.norm(normal)
    xyz = patch(np.random.default_rng(3), normal, 0.8)
    points = Points(1.01 * xyz, np.full(len(xyz), 0.002), np.arange(len(xyz)))
    plane = refine(points, Plane(normal, 0.8), ScoreConfig(), EXACT, Distortion(share=0.01)).plane
    error = plane.offset_m - 0.8
    assert error == pytest.approx(0.008, abs=1e-6)
    assert np.sqrt(plane.covariance[2, 2]) > 0.7 * error  # one deviation of scale is one of height


def test_collinear_points_give_no_plane():
    t = np.linspace(1.0, 2.0, 500)
    xyz = np.column_stack([0.1 * t, np.full(500, 0.4), t])
    line = Points(xyz[:, [0, 1, 2]], np.full(500, 0.005), np.arange(500))
    start = Plane(np.array([0.0, -1.0, 0.0]), 0.4)
    assert refine(line, start, ScoreConfig(), EXACT) is None


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_fusing_is_the_product_of_two_gaussians(seed):
    rng = np.random.default_rng(seed)
    normal = rng.normal(size=3)
    normal /= np.linalg.norm(normal)
    measured, prior = (
        Plane(
            normal,
            1.0 + 0.01 * k,
            (lambda m: m @ m.T + 1e-6 * np.eye(3))(0.01 * rng.normal(size=(3, 3))),
        )
        for k in range(2)
    )
    fused, distance = fuse(measured, prior)
    W = np.linalg.inv(measured.covariance) + np.linalg.inv(prior.covariance)
    e = np.array([0.0, 0.0, 0.01])
    shift = np.linalg.solve(W, np.linalg.solve(prior.covariance, e))
    np.testing.assert_allclose(measured.error_to(fused), shift, atol=1e-3 * np.abs(shift).max())
    assert np.trace(fused.covariance) <= np.trace(measured.covariance) + 1e-12
    expected = e @ np.linalg.solve(measured.covariance + prior.covariance, e)
    assert distance == pytest.approx(expected, rel=1e-9)


def test_fusing_turns_the_prior_into_the_axes_of_the_measurement():
    """Two planes a hair apart whose tangents differ by a quarter turn: each knows one tilt only."""
    one = np.array([0.3, -0.9, 0.3 + 1e-6])
    other = np.array([0.3 + 1e-6, -0.9, 0.3])
    measured_normal, prior_normal = (n / np.linalg.norm(n) for n in (one, other))
    first = Plane(measured_normal, 1.0).tangents
    second = Plane(prior_normal, 1.0).tangents
    assert abs(float(first[0] @ second[0])) < 0.9  # else nothing is to be turned
    known, unknown = 1e-3**2, 0.1**2
    measured = Plane(measured_normal, 1.0, np.diag([known, unknown, 1e-4]))
    across = second @ first.T  # (second, first)
    tilts = across @ np.diag([unknown, known]) @ across.T  # the prior knows the other tilt
    P = np.zeros((3, 3))
    P[:2, :2], P[2, 2] = tilts, 1e-4
    fused, _ = fuse(measured, Plane(prior_normal, 1.0, P))
    assert np.sqrt(np.diag(fused.covariance)[:2]) == pytest.approx([1e-3, 1e-3], rel=0.01)


def test_a_plane_that_may_be_a_ledge_has_the_moments_of_the_mixture():
    up = np.array([0.2, -0.9, -0.3])
    up /= np.linalg.norm(up)
    measured = Plane(up, 1.1, np.diag([0.01**2, 0.02**2, 0.01**2]))
    aside = up + 0.03 * measured.tangents[0]
    prior = Plane(aside / np.linalg.norm(aside), 1.2, np.diag([0.07**2, 0.07**2, 0.1**2]))
    rng, chance = np.random.default_rng(0), 0.4
    true = rng.random(200_000) < chance
    one = rng.multivariate_normal(np.zeros(3), measured.covariance, 200_000)
    apart = measured.error_to(prior)
    other = apart + rng.multivariate_normal(np.zeros(3), prior.covariance, 200_000)
    drawn = np.where(true[:, None], one, other)
    found = mixed(measured, prior, chance)
    np.testing.assert_allclose(measured.error_to(found), drawn.mean(axis=0), atol=1e-3)
    np.testing.assert_allclose(found.covariance, np.cov(drawn.T), atol=3e-4)
    assert mixed(measured, prior, 1.0) is measured


def test_the_compiled_score_equals_that_of_numpy():
    rng = np.random.default_rng(4)
    sample = Sample(*rng.normal(size=(3, 700)), np.abs(rng.normal(0.02, 0.01, 700)))
    plane = Plane(np.array([0.6, -0.8, 0.0]), 0.5)
    config = ScoreConfig()
    d = np.column_stack([sample.x, sample.y, sample.z]) @ plane.normal + plane.offset_m
    t = d / (config.base_m + sample.slack * plane.offset_m)
    expected = np.maximum(1.0 - (SHARP * t) ** 2, 0.0).sum() - PENALTY * np.sum(t < -2.0)
    assert score(sample, plane, config) == pytest.approx(expected, rel=1e-9)


def test_the_compiled_sums_equal_those_of_numpy():
    rng = np.random.default_rng(5)
    n, rho = np.array([0.1, -0.95, -0.3]), 0.5
    n /= np.linalg.norm(n)
    xyz = patch(rng, n, rho, 500) * (1.0 + 0.01 * rng.normal(size=(500, 1)))
    sigma = rng.uniform(0.002, 0.02, 500)
    A, g, is_open = np.zeros((3, 3)), np.zeros(3), rng.random(500) < 0.8
    count = kernels.moments(xyz, sigma, is_open, n, rho, np.zeros(500), 2.5, 0.003, A, g)
    z = xyz[:, 2]
    e = 1.0 / z + xyz @ n / (rho * z)  # 1/z - a.r
    variance = (sigma / z**2) ** 2 + (0.003 / (rho * z)) ** 2
    near = is_open & (e**2 < 2.5**2 * variance)
    r, w = (xyz / z[:, None])[near], 1.0 / variance[near]
    assert count == near.sum()
    np.testing.assert_allclose(A, (r * w[:, None]).T @ r, rtol=1e-9)
    np.testing.assert_allclose(g, (r * w[:, None]).T @ e[near], rtol=1e-6, atol=1e-9 * A.max())


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"narrow_sigmas": 6.0}, "narrow_sigmas=6.0"),
        ({"rough_m": -1.0}, "rough_m=-1.0"),
    ],
)
def test_invalid_settings_are_refused_with_a_message(values, message):
    with pytest.raises(ConfigError, match=message):
        RefineConfig(**values)


def test_a_stereo_floor_is_fitted_as_in_disparity_space():
    """Reference: least squares of d = a u + b v + c on the same pixels; a fit in space is far worse."""
    f, baseline, u0, v0, height = 554.3, 0.04, 319.5, 239.5, 0.45
    normal = np.array([0.03, -0.88, -0.47])
    normal /= np.linalg.norm(normal)
    v, u = (axis.ravel().astype(float) for axis in np.mgrid[60:480:4, 0:640:4])
    rays = np.column_stack([(u - u0) / f, (v - v0) / f, np.ones_like(u)])
    true = -f * baseline * (rays @ normal) / height  # d = f B / z
    mine, space = [], []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        d = true + 0.25 * rng.normal(size=true.shape)
        keep = d > 5.5
        z = f * baseline / d[keep]
        points = Points(rays[keep] * z[:, None], 0.25 * z**2 / (f * baseline), np.arange(len(z)))
        plane = refine(points, Plane(normal, height), ScoreConfig(), WIDE).plane
        A = np.column_stack([u[keep], v[keep], np.ones(len(z))])
        a, b, c = np.linalg.lstsq(A, d[keep], rcond=None)[0]
        slope = np.array([a * f, b * f, a * u0 + b * v0 + c]) / (f * baseline)
        twin = -slope / np.linalg.norm(slope)
        np.testing.assert_allclose(plane.normal, twin, atol=1e-7)
        assert plane.offset_m == pytest.approx(1.0 / np.linalg.norm(slope), abs=1e-7)
        middle = points.xyz.mean(axis=0)
        flat = np.linalg.eigh(np.cov((points.xyz - middle).T))[1][:, 0]
        mine.append(np.arccos(min(1.0, abs(float(plane.normal @ normal)))))
        space.append(np.arccos(min(1.0, abs(float(flat @ normal)))))
    assert np.median(space) > 2.0 * np.median(mine)


def bent_patch(rng, fov_deg, height, pitch_deg, noise_m, ripples):
    """A floor up to 4 m away, seen by a camera whose depth bends as the distortion says, and the true plane."""
    edge, pitch = np.tan(np.radians(fov_deg / 2.0)), np.radians(pitch_deg)
    u, v = np.meshgrid(np.linspace(-edge, edge, 80), np.linspace(-0.75 * edge, 0.75 * edge, 60))
    rays = np.column_stack([u.ravel(), v.ravel(), np.ones(u.size)])
    normal = np.array([0.0, -np.cos(pitch), -np.sin(pitch)])
    rays = rays[-rays @ normal > height / 4.0]
    z = -height / (rays @ normal)
    sigma = noise_m * (0.3 + z * z)
    bend = DistortionConfig().depth
    field = bend.field(rays[:, 0], rays[:, 1], z, sigma, edge)
    places = np.floor((rays[:, :2] + 2.0) * 6.0).astype(int)  # of ripples, 10 deg wide
    local = ripples * bend.size(z, sigma) * rng.normal(size=(24, 24))[places[:, 0], places[:, 1]]
    seen = z * (1.0 + field @ rng.normal(size=field.shape[1]) + local) + sigma * rng.normal(
        size=z.size
    )
    return Points(rays * seen[:, None], sigma, np.arange(z.size)), Plane(normal, height)


@pytest.mark.parametrize(
    ("fov_deg", "height", "pitch_deg", "noise_m", "ripples"),
    [(58.0, 0.9, 27.0, 0.002, 0.0), (90.0, 1.3, 45.0, 0.004, 0.25), (70.0, 1.1, 40.0, 0.001, 0.25)],
)
def test_the_covariance_of_a_bent_floor_holds(fov_deg, height, pitch_deg, noise_m, ripples):
    squares = []
    for seed in range(200):
        rng = np.random.default_rng([seed, 11])
        points, truth = bent_patch(rng, fov_deg, height, pitch_deg, noise_m, ripples)
        plane = refine(points, truth, ScoreConfig(), RefineConfig(), DistortionConfig().depth).plane
        error = plane.error_to(truth)
        squares.append(float(error @ np.linalg.solve(plane.covariance, error)) / 3.0)
    assert 0.85 < np.mean(squares) < 1.2  # its own deviation is 0.06
