"""The dynamic walk on trial: random commands on bumpy, sloping ground and under pushes.

Every walk is another body (zeros of the joints), another floor and other commands, drawn anew for every
step from all that the gait allows; three times a walk that is pushed somebody pushes, from anywhere, at
any instant. A fall is a fall, whenever it comes. What the feet made of the commands
and how the head swayed is measured on the floor with the usual bumps.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from perception.primitives.errors import InputError
from perception.primitives.pose import Pose2, wrap_angle
from planning.commands import WalkCommand

from ..support.experiment import Experiment, Outcome, Say, Target
from ..support.trials import each

STEPS = 300
PUSH_N, PUSH_S, PUSH_EVERY = 10.0, 0.1, 100
SLOPE_RAD = 0.04
SAMPLE_TICKS = 5  # the head is looked at 40 times a second
STEP_S = 0.65
FLOOR_M = 4.0  # half its side; a random walk of 300 steps seldom gets further


@dataclass(frozen=True)
class Trial:
    """One kind of ground, and whether somebody pushes."""

    name: str
    bump_m: float = 0.002
    sloping: bool = False
    pushed: bool = False


TRIALS = (
    Trial("falls"),
    Trial("falls_4mm", bump_m=0.004),
    Trial("falls_slope", sloping=True),
    Trial("falls_pushed", pushed=True),
)


@dataclass(frozen=True, eq=False)
class Walked:
    """What came of one walk.

    Args:
        trial, seed: Which.
        steps: Made before it fell, or all.
        fallen: Whether it fell.
        errors: True step in the commanded one, (n, 3): m, m, rad.
        head: Roll, pitch, yaw of the head against upright and the feet, rad; height, sideways place, m;
            (m, 5), evenly in time.
        realtime_factor: Time walked over time computed.
    """

    trial: str
    seed: int
    steps: int
    fallen: bool
    errors: Float[np.ndarray, "n 3"]
    head: Float[np.ndarray, "m 5"]
    realtime_factor: float


def walk(trial: Trial, seed: int) -> Walked:
    """One walk of random commands."""
    from sim.body.dynamic.config import DynamicConfig
    from sim.body.dynamic.walker import DynamicBody
    from sim.body.gait import GaitConfig
    from sim.body.head import Head, HeadConfig
    from sim.body.inertial import ImuConfig
    from sim.scene import FloorArea, Scene
    from sim.world import World

    streams = np.random.SeedSequence([seed, 61]).spawn(3)
    body_rng, head_rng, rng = (np.random.default_rng(s) for s in streams)
    uphill = rng.uniform(0.0, 2.0 * math.pi)
    slope = SLOPE_RAD * float(trial.sloping)
    config = DynamicConfig(
        bump_m=trial.bump_m, slope_rad=(slope * math.cos(uphill), slope * math.sin(uphill))
    )
    extent = (-FLOOR_M, -FLOOR_M, FLOOR_M, FLOOR_M)
    floor = (FloorArea("plaster/white", extent),)
    scene = Scene("floor", seed, extent, floor, (), (), (), Pose2(), ())
    gait = GaitConfig()
    with World(scene, "tiny", seed) as world:
        head = Head(HeadConfig(), head_rng)
        body = DynamicBody(world, gait, config, ImuConfig(), head, body_rng)
        began = time.process_time()
        errors, sway, steps = _commands(body, gait, trial, rng)
        seconds = time.process_time() - began
        walked = body.ticks * gait.tick_s
        fallen = body.fallen
        body.close()
    return Walked(trial.name, seed, steps, fallen, errors, sway, walked / seconds)


def run(seeds: int, say: Say, body: str = "dynamic") -> Outcome:
    """Every kind of ground, seeds 0 to n - 1.

    Raises:
        InputError: a body that cannot fall.
    """
    if body != "dynamic":
        raise InputError(
            f"experiment walking: body={body} makes exact footsteps and cannot fall; "
            "take --body dynamic, or leave it out"
        )
    todo = [(trial, seed) for trial in TRIALS for seed in range(seeds)]
    found: list[Walked] = []
    for one in each(walk, todo):
        found.append(one)
        fell = sum(w.fallen for w in found)
        say(f"{len(found)} of {len(todo)} walks, {fell} falls")
    usual = [one for one in found if one.trial == TRIALS[0].name]
    errors = np.concatenate([one.errors for one in usual])
    drift = [abs(float(one.errors[:, 2].mean())) for one in usual if len(one.errors)]
    figures: dict[str, float] = {
        trial.name: float(sum(one.fallen for one in found if one.trial == trial.name))
        for trial in TRIALS
    }
    figures |= {
        "step_length_error_mm": 1e3 * float(np.sqrt(np.mean(errors[:, 0] ** 2))),
        "step_side_error_mm": 1e3 * float(np.sqrt(np.mean(errors[:, 1] ** 2))),
        "heading_error_deg_per_step": math.degrees(float(np.sqrt(np.mean(errors[:, 2] ** 2)))),
        "heading_drift_deg_per_step": math.degrees(float(np.mean(drift))),
        "realtime_factor": float(np.median([one.realtime_factor for one in found])),
    }
    head = np.concatenate([one.head - one.head.mean(axis=0) for one in usual])
    for name, unit, column in CHANNELS:
        figures[f"{name}_std"] = unit * float(head[:, column].std())
        figures[f"{name}_p99"] = unit * float(np.percentile(np.abs(head[:, column]), 99))
    return Outcome(figures, _table(found, usual))


CHANNELS = (
    ("head_roll_deg", 180.0 / math.pi, 0),
    ("head_pitch_deg", 180.0 / math.pi, 1),
    ("head_yaw_deg", 180.0 / math.pi, 2),
    ("head_height_mm", 1e3, 3),
    ("head_sideways_mm", 1e3, 4),
)


def spectrum(
    swayed: Float[np.ndarray, "m"], multiples: int
) -> tuple[Float[np.ndarray, "k"], Float[np.ndarray, "k"]]:
    """How much of a sway lies about each multiple of the walk's own frequency (two steps).

    Args:
        swayed: Evenly in time, `SAMPLE_TICKS` apart.
        multiples: How many of them, k.

    Returns:
        The frequencies, Hz, and the deviation that each half-octave-free band holds: all from half a
        multiple below to half above. Squared and summed they give the variance but for what is slower.
    """
    tick_s = 0.005 * SAMPLE_TICKS
    power = 2.0 * np.abs(np.fft.rfft(swayed - swayed.mean())) ** 2 / len(swayed) ** 2
    frequency = np.fft.rfftfreq(len(swayed), tick_s)
    base = 1.0 / (2.0 * STEP_S)
    middle = base * np.arange(1, multiples + 1)
    band = [np.abs(frequency - one) < base / 2 for one in middle]
    return middle, np.sqrt([power[one].sum() for one in band])


def _commands(body, gait, trial: Trial, rng: np.random.Generator):  # type: ignore[no-untyped-def]
    """Walk until all commands are made, or the robot lies on the floor."""
    errors, sway = [], []
    before = planned = None
    steps = 0
    for number in range(STEPS):
        body.walk(_random_command(gait, rng))
        body.start_due_step()
        push_at = -1
        if trial.pushed and number % PUSH_EVERY == PUSH_EVERY // 2:
            push_at = int(rng.integers(body.ticks_left))
            angle = rng.uniform(0.0, 2.0 * math.pi)
            force = PUSH_N * np.array([math.cos(angle), math.sin(angle), 0.0])
        while body.ticks_left > 0 and not body.fallen:
            if 0 <= push_at < SAMPLE_TICKS:
                body.push(force, PUSH_S)
            push_at -= SAMPLE_TICKS
            body.advance(min(SAMPLE_TICKS, body.ticks_left))
            sway.append(_head(body))
        if body.fallen:
            break
        steps += 1
        now, plan = body.true_pose, body.planned_pose
        if before is not None and planned is not None:
            made, asked = before.inverse() @ now, planned.inverse() @ plan
            errors.append((asked.inverse() @ made).vector)
        before, planned = now, plan
    return np.array(errors).reshape(-1, 3), np.array(sway), steps


def _random_command(gait, rng: np.random.Generator) -> WalkCommand:  # type: ignore[no-untyped-def]
    turn = math.radians(gait.turn_limit_deg)
    return WalkCommand(
        float(rng.uniform(-gait.backward_limit_m, gait.forward_limit_m)),
        float(rng.uniform(-gait.lateral_limit_m, gait.lateral_limit_m)),
        float(rng.uniform(-turn, turn)),
    )


def _head(body) -> list[float]:  # type: ignore[no-untyped-def]
    """Roll, pitch, yaw, height and sideways place of the head, upright and over the feet."""
    pose = body.true_pose.inverse().lifted() @ body.head_pose()
    R = pose.rotation
    (left, _), (right, _) = body.feet_body
    feet = left.yaw + wrap_angle(right.yaw - left.yaw) / 2
    return [
        math.atan2(R[2, 1], R[2, 2]),
        math.asin(-R[2, 0]),
        wrap_angle(math.atan2(R[1, 0], R[0, 0]) - feet),
        pose.translation[2],
        pose.translation[1],
    ]


def _table(found: list[Walked], usual: list[Walked]) -> list[str]:
    lines = [f"{len(found)} walks of {STEPS} random commands"]
    fallen = [one for one in found if one.fallen]
    lines += [f"  {one.trial}: seed {one.seed} fell in step {one.steps + 1}" for one in fallen]
    lines.append("sway of the head about each multiple of the walk's frequency, deviation")
    whole = [one.head for one in usual if not one.fallen]
    if not whole:
        return lines
    for name, unit, column in CHANNELS:
        bands = [spectrum(head[:, column], 6) for head in whole]
        mean = unit * np.sqrt(np.mean([power**2 for _, power in bands], axis=0))
        if column == 0:
            heads = "".join(f"{f:8.2f}" for f in bands[0][0])
            lines.append(f"  {'Hz':<18}{heads}")
        lines.append(f"  {name:<18}" + "".join(f"{value:8.2f}" for value in mean))
    return lines


EXPERIMENT = Experiment(
    id="walking",
    title="The dynamic walk: bumps, slope, pushes; what becomes of commands; sway of the head",
    run=run,
    body="dynamic",
    targets={
        "falls": Target("==", 0.0),
        "falls_4mm": Target("<=", 1.0),
        "falls_slope": Target("==", 0.0),
        "falls_pushed": Target("==", 0.0),
        "realtime_factor": Target(">=", 8.0),
    },
    published={  # walking trials with a body of these measures
        "head_roll_deg_std": 0.72,
        "head_roll_deg_p99": 2.8,
        "head_pitch_deg_std": 0.5,
        "head_pitch_deg_p99": 1.5,
        "head_yaw_deg_std": 0.4,
        "head_yaw_deg_p99": 1.6,
        "head_height_mm_std": 0.3,
        "head_height_mm_p99": 0.9,
        "head_sideways_mm_std": 27.0,
        "head_sideways_mm_p99": 37.0,
        "heading_drift_deg_per_step": 0.17,
    },
    seeds=20,
)
