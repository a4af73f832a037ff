"""Parts of the referee experiment on truth: breaks, claimed steps, conformal coverage, events."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from perception.odometry.pose_uncertainty import compounded
from perception.primitives.camera import Camera
from perception.primitives.frame import ColourView, DepthView, Frame
from perception.primitives.pose import Pose3
from surefoot.experiments.real.broken_recordings import BREAKS, CROWD_SHARE, SCALES
from surefoot.experiments.real.leaderboard import Track, row
from surefoot.experiments.real.odometry_alarm import Event, Shot, fails
from surefoot.experiments.real.referee import conformal

CAMERA = Camera(160, 120, 140.0, 140.0, 79.5, 59.5)
SIGMA = np.array([0.004] * 3 + [0.003] * 3)


def frames(n: int) -> list[Frame]:
    rng = np.random.default_rng(0)
    return [
        Frame(
            0.1 * k,
            depth=DepthView(np.full((120, 160), 3.0 + 0.1 * k, np.float32), CAMERA),
            colour=ColourView(rng.integers(0, 255, (120, 160, 3), np.uint8), CAMERA),
            T_world_camera=Pose3((0.1 * k, 0.0, 0.0)),
        )
        for k in range(n)
    ]


def spoilt(kind: str) -> list[Frame]:
    return BREAKS[kind](frames(6), 0.1, np.random.default_rng(1))


def test_breaks_spoil_what_their_names_say():
    given = frames(6)
    assert spoilt("dropped") == []
    assert all(np.isnan(f.depth.depth).all() and not f.colour.rgb.any() for f in spoilt("blackout"))
    assert all(np.array_equal(f.depth.depth, given[0].depth.depth) for f in spoilt("frozen"))
    ratios = [
        f.depth.depth / g.depth.depth for f, g in zip(spoilt("wrong_scale"), given, strict=True)
    ]
    factor = float(ratios[0][0, 0])
    assert SCALES[0] <= max(factor, 1 / factor) <= SCALES[1]
    np.testing.assert_allclose(ratios, factor, rtol=1e-6)
    sharp, soft = (
        np.diff(f[0].colour.rgb.astype(float), axis=1).std() for f in (given, spoilt("blur"))
    )
    assert soft < sharp / 3
    assert [f.T_world_camera for f in spoilt("crowd")] == [f.T_world_camera for f in given]


def test_a_crowd_hides_its_share_of_the_picture_and_walks():
    near = [f.depth.depth < 2.0 for f in spoilt("crowd")]
    shares = [float(one.mean()) for one in near]
    assert CROWD_SHARE[0] * 0.6 <= min(shares) <= max(shares) <= CROWD_SHARE[1] * 1.2
    assert any((a != b).any() for a, b in zip(near[1:], near[:-1], strict=True))


def track(seed: int, claim: float = 1.0, n: int = 200, keep: int = 1) -> Track:
    """A frame-by-frame odometry (keep=1), or one by reference images, with independent errors."""
    rng = np.random.default_rng(seed)
    found, shared, to = [Pose3()], [np.zeros((6, 6))], [0]
    true = [Pose3()]
    for k in range(1, n):
        reference = (k - 1) // keep * keep
        turn = Rotation.from_rotvec([0.02 * np.sin(k / 9), 0.03, 0.0]).as_matrix()
        true.append(true[-1] @ Pose3.from_rotation(turn, np.array([0.03, 0.0, 0.02])))
        motion = true[reference].inverse() @ true[k]
        e = SIGMA * rng.normal(size=6)
        measured = Pose3.from_rotation(
            Rotation.from_rotvec(e[3:]).as_matrix() @ motion.rotation, motion.position + e[:3]
        )
        step = np.diag(SIGMA**2) / claim**2
        shared.append(compounded(shared[reference], found[reference], measured, step))
        found.append(found[reference] @ measured)
        to.append(reference)
    return Track(found, true, shared, to)


@pytest.mark.parametrize("keep", [1, 7])
@pytest.mark.parametrize("claim", [1.0, 3.0])
def test_claims_of_steps_are_judged_by_their_true_factor(keep, claim):
    figures, line = row("walk", "mine", track(0, claim, keep=keep))
    assert figures["walk_mine_step_sigma_factor"] == pytest.approx(claim, rel=0.08)
    assert ("too sure" in line) or claim == 1.0


def test_a_method_without_covariances_or_without_package_is_said_to_be_so():
    bare = track(1, n=20)
    bare.shared = [np.full((6, 6), np.nan)] * 20
    assert "no covariance" in row("walk", "mine", bare)[1]
    assert "not installed" in row("walk", "mine", None)[1]


class Drawn(Track):
    """Motions with heavy tails, claimed too small by three or not at all."""

    def steps(self) -> tuple[np.ndarray, np.ndarray]:
        errors = np.random.default_rng(self.lost).standard_t(4, size=(1000, 6)) * SIGMA
        return errors, np.tile(np.diag(SIGMA**2) / 9.0, (1000, 1, 1))


def test_conformal_regions_hold_on_the_second_halves_whatever_was_claimed():
    claimed, nothing = [np.eye(6)], [np.full((6, 6), np.nan)]
    figures, _ = conformal(
        {
            "sure": [Drawn(shared=claimed, lost=seed) for seed in range(4)],
            "bare": [Drawn(shared=nothing, lost=seed) for seed in range(4, 8)],
        }
    )
    assert figures["sure_claimed_90"] < 0.3
    for method in ("sure", "bare"):  # 2000 motions in each half: three standard deviations
        assert figures[f"{method}_conformal_90"] == pytest.approx(0.9, abs=0.03)
    assert figures["conformal_90_min"] <= figures["conformal_90_max"]


def test_a_slip_within_ten_frames_is_a_failure_and_an_alarm_after_it_too_late():
    def shots(off: float) -> list[Shot]:
        true = [Pose3((0.1 * k, 0.0, 0.0)) for k in range(20)]
        return [
            Shot(Pose3((0.1 * k + off * max(0, k - 10), 0.0, 0.0)), true[k], "tracked", False)
            for k in range(20)
        ]

    assert not any(fails(shots(0.005), k) for k in range(20))
    assert [fails(shots(0.03), k) for k in (10, 13, 14, 19)] == [False, False, True, True]
    assert fails([Shot(Pose3(), Pose3(), "lost", True)], 0)
    assert Event("blur", 3, 4, False).caught
    assert not Event("blur", 5, 4, False).caught
    assert not Event("blur", None, 4, False).caught
