"""Hip strategy: against the masses of the links, and on bodies that are pushed."""

import math

import numpy as np
import pytest

from planning.commands import WalkCommand
from sim.body.dynamic.anatomy import DARWIN
from sim.body.dynamic.balance import BalanceConfig
from sim.body.dynamic.config import DynamicConfig
from sim.body.dynamic.hip_strategy import BEND_RADPS, BEND_RADPS2, STRAIGHTEN_RADPS, HipStrategy
from sim.body.dynamic.legs import Legs, tilt_rotation
from sim.body.dynamic.walker import DynamicBody
from sim.body.gait import GaitConfig
from sim.body.head import Head, HeadConfig
from sim.body.inertial import ImuConfig
from sim.world import World

TICK_S = 0.005
BENDS = BalanceConfig()
STIFF = BalanceConfig(bend_most_rad=(0.0, 0.0))


def bent(error, ticks, hips=None):
    hips = hips or HipStrategy(BENDS, TICK_S)
    rates = []
    for _ in range(ticks):
        hips.update(np.array(error))
        rates.append(hips.rate.copy())
    return hips, np.array(rates)


def test_the_trunk_bends_in_the_direction_of_the_fall_and_straightens_slowly():
    for ahead, left in ((0.05, 0.0), (-0.05, 0.0), (0.0, 0.05), (0.0, -0.05), (0.04, -0.06)):
        hips, rates = bent((ahead, left), 60)
        roll, pitch = hips.bend
        assert np.sign([pitch, -roll]) == pytest.approx(np.sign([ahead, left]))
        assert np.all(np.abs(rates) <= BEND_RADPS)
        assert np.all(np.abs(np.diff(rates, axis=0)) <= BEND_RADPS2 * TICK_S + 1e-12)
        before = hips.bend.copy()
        hips, rates = bent((0.0, 0.0), 100, hips)
        assert np.all(np.abs(rates[20:]) <= STRAIGHTEN_RADPS + 1e-12)
        assert np.all(np.abs(hips.bend) <= np.abs(before))
        hips, _ = bent((0.0, 0.0), 800, hips)
        assert hips.bend == pytest.approx((0.0, 0.0), abs=1e-3)
    hips, _ = bent((10.0, -10.0), 200)
    assert hips.bend == pytest.approx(BENDS.bend_most_rad, abs=0.02)


def test_errors_in_the_dead_band_do_not_bend_the_trunk():
    most = BENDS.deadband_m
    hips, _ = bent((most, -most), 50)
    assert not hips.bend.any()


@pytest.mark.parametrize("bend", [(0.0, 0.4), (0.0, -0.4), (0.3, 0.0), (-0.2, 0.3)])
def test_mass_centre_stays_over_the_feet_while_the_trunk_bends(bend):
    legs, bend = Legs(DARWIN), np.array(bend)
    feet = [np.array([0.0, side * 0.045, DARWIN.ankle_m, 0.0]) for side in (1, -1)]

    def mass_centre(shift):
        pelvis = np.array([-shift[0], -shift[1], 0.195, 0.0])
        angles = legs.solve(pelvis, *feet, bend)
        return (pelvis[:3] + tilt_rotation(bend) @ legs.centre_of_mass(angles))[:2]

    level = np.array([0.0, 0.0, 0.195, 0.0])
    there = level[:2] + legs.centre_of_mass(legs.solve(level, *feet))[:2]
    moved = np.linalg.norm(mass_centre(np.zeros(2)) - there)
    kept = np.linalg.norm(mass_centre(legs.com_shift(bend)) - there)
    assert moved > 0.008
    assert kept < 0.4 * moved  # the legs tilt a little as the pelvis shifts


def test_bending_prevents_falls_outward_over_the_stance_foot(pushed):
    fallen = {
        balance: sum(
            pushed(balance, seed, WalkCommand(ahead), 0.0, -math.pi / 2, 9)[1]
            for seed in range(6)
            for ahead in (0.03, 0.06)
        )
        for balance in (BENDS, STIFF)
    }
    assert fallen[BENDS] <= 4
    assert fallen[STIFF] >= fallen[BENDS] + 2  # of the same 12 pushes


def estimated_trunks(scene, seed):
    """Error of each estimated trunk that bends after a push, the greatest bend, and whether the body fell."""
    body_rng, head_rng = (np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(2))
    off, most = [], 0.0
    with World(scene, "tiny", seed) as world:
        head = Head(HeadConfig(), head_rng)
        body = DynamicBody(world, GaitConfig(), DynamicConfig(), ImuConfig(), head, body_rng)
        for number in range(9):
            body.walk(WalkCommand(0.03))
            body.start_due_step()
            if number == 5:
                body.advance(20)
                body.push(np.array([-11.0, 0.0, 0.0]), 0.1)
            while body.ticks_left > 0:
                body.advance(min(5, body.ticks_left))
                bend = float(np.abs(body._hips.bend).max())
                most = max(most, bend)
                if bend > 0.1:
                    off.append(body.true_trunk().inverse() @ body.trunk_from_encoders())
        body.close()
    return off, most, body.fallen


def test_the_estimated_trunk_is_accurate_while_it_bends(bare_floor):
    """A push of 1.1 N s may end in a fall, which lifts the stance foot: three of four bodies must stand."""
    walks = [estimated_trunks(bare_floor, seed) for seed in range(4)]
    standing = [(off, most) for off, most, fallen in walks if not fallen]
    assert len(standing) >= 3
    assert max(most for _, most in standing) > 0.2
    off = [one for each, _ in standing for one in each]
    assert len(off) > 30
    turned = [math.degrees(math.acos((np.trace(one.rotation) - 1.0) / 2.0)) for one in off]
    place = [float(np.linalg.norm(one.translation)) for one in off]
    assert np.sqrt(np.mean(np.square(turned))) < 1.5
    assert np.sqrt(np.mean(np.square(place))) < 0.012


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("angle", [0.0, 0.5 * math.pi, math.pi, -0.5 * math.pi])
def test_a_fall_is_detected_for_any_bend_of_the_trunk(bare_floor, angle, seed):
    body_rng, head_rng = (np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(2))
    with World(bare_floor, "tiny", seed) as world:
        head = Head(HeadConfig(), head_rng)
        body = DynamicBody(world, GaitConfig(), DynamicConfig(), ImuConfig(), head, body_rng)
        body.push(25.0 * np.array([math.cos(angle), math.sin(angle), 0.0]), 0.1)
        for _ in range(6):
            body.walk(WalkCommand(0.03))
            body.advance(130)
        upright = float(body.physics.pelvis().rotation[2, 2])
        assert body.fallen
        body.close()
    assert upright < math.cos(
        math.radians(60.0)
    )  # the trunk lies, whichever part touches the floor
