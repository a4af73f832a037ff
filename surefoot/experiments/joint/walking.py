"""Stability of the dynamic walk: random commands on bumpy and sloping ground, and under pushes.

Every walk has another body (joint offsets), another floor, and a random command within the gait limits at every step;
in pushed walks the body is pushed three times, from random directions at random instants. Every fall counts. Step
errors and head sway are measured on the floor with standard bumps.

Source: ours; the published figures are walking trials with a body of this size.
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

from ...evaluation.metrics.averages import rms
from ..support.experiment import Experiment, Outcome, Say, Target
from ..support.trials import run_all

COMMANDS = 300
PUSH_N, PUSH_S, PUSH_EVERY = 10.0, 0.1, 100
SLOPE_RAD = 0.04
SAMPLE_TICKS = 5  # the head pose is sampled at 40 Hz
STEP_S = 0.65
FLOOR_M = 4.0  # half the side; a random walk of 300 steps rarely goes further


@dataclass(frozen=True)
class Trial:
    """One kind of ground, with or without pushes, in a physics engine."""

    name: str
    bump_m: float = 0.002
    sloping: bool = False
    pushed: bool = False
    engine: str = "pybullet"


TRIALS = (
    Trial("falls"),
    Trial("falls_4mm", bump_m=0.004),
    Trial("falls_slope", sloping=True),
    Trial("falls_pushed", pushed=True),
)


@dataclass(frozen=True, eq=False)
class WalkResult:
    """Result of one walk.

    Args:
        trial, seed: The walk.
        steps: Steps before a fall, or all.
        fallen: Whether the robot fell.
        errors: True step relative to the commanded one, (n, 3): m, m, rad.
        true, told: The steps of `errors`, from body pose to body pose, in truth and by odometry, (n, 3): m, m, rad.
        slips: Displacement of the stance foot while the other swings, (n, 2): m, rad.
        head: Roll, pitch and yaw of the head relative to vertical and to the feet, rad, and its height and lateral
            position, m; (m, 5), evenly sampled.
        realtime_factor: Simulated time divided by computing time.
    """

    trial: str
    seed: int
    steps: int
    fallen: bool
    errors: Float[np.ndarray, "n 3"]
    true: Float[np.ndarray, "n 3"]
    told: Float[np.ndarray, "n 3"]
    slips: Float[np.ndarray, "n 2"]
    head: Float[np.ndarray, "m 5"]
    realtime_factor: float


def walk(trial: Trial, seed: int, commands: int = COMMANDS) -> WalkResult:
    """Simulate one walk with so many random commands."""
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
        engine=trial.engine,
        bump_m=trial.bump_m,
        slope_rad=(slope * math.cos(uphill), slope * math.sin(uphill)),
    )
    extent = (-FLOOR_M, -FLOOR_M, FLOOR_M, FLOOR_M)
    floor = (FloorArea("plaster/white", extent),)
    scene = Scene("floor", seed, extent, floor, (), (), (), Pose2(), ())
    gait = GaitConfig()
    with World(scene, "tiny", seed) as world:
        head = Head(HeadConfig(), head_rng)
        body = DynamicBody(world, gait, config, ImuConfig(), head, body_rng)
        began = time.process_time()
        steps, errors, true, told, slips, head_sway = _commands(body, gait, trial, rng, commands)
        seconds = time.process_time() - began
        walked = body.ticks * gait.tick_s
        fallen = body.fallen
        body.close()
    return WalkResult(
        trial.name,
        seed,
        steps,
        fallen,
        errors,
        true,
        told,
        slips,
        head_sway,
        walked / seconds,
    )


def run(seeds: int, say: Say, body: str = "dynamic", commands: int = COMMANDS) -> Outcome:
    """Every kind of ground, seeds 0 to n - 1, with so many commands a walk.

    Raises:
        InputError: The body is not "dynamic".
    """
    if body != "dynamic":
        raise InputError(
            f"experiment walking: body={body} makes exact footsteps and cannot fall; "
            "use --body dynamic, or omit the option"
        )
    todo = [(trial, seed, commands) for trial in TRIALS for seed in range(seeds)]
    found = run_all(walk, todo, say, "walks")
    standard = [one for one in found if one.trial == TRIALS[0].name]
    errors = np.concatenate([one.errors for one in standard])
    drift = [abs(float(one.errors[:, 2].mean())) for one in standard if len(one.errors)]
    figures: dict[str, float] = {
        trial.name: float(sum(one.fallen for one in found if one.trial == trial.name))
        for trial in TRIALS
    }
    figures |= {
        "step_length_error_mm": 1e3 * rms(errors[:, 0]),
        "step_side_error_mm": 1e3 * rms(errors[:, 1]),
        "heading_error_deg_per_step": math.degrees(rms(errors[:, 2])),
        "heading_drift_deg_per_step": math.degrees(float(np.mean(drift))),
        "realtime_factor": float(np.median([one.realtime_factor for one in found])),
    }
    head = np.concatenate([one.head - one.head.mean(axis=0) for one in standard])
    for name, unit, column in CHANNELS:
        figures[f"{name}_std"] = unit * float(head[:, column].std())
        figures[f"{name}_p99"] = unit * float(np.percentile(np.abs(head[:, column]), 99))
    return Outcome(figures, _table(found, standard, commands))


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
    """Amplitude of a sway around each multiple of the walk's fundamental frequency (two steps).

    Args:
        swayed: Samples at intervals of `SAMPLE_TICKS`.
        multiples: Number of multiples k.

    Returns:
        The frequencies, Hz, and the standard deviation in the band half a fundamental below to half above each.
        Their squares sum to the variance without its lower frequencies.
    """
    tick_s = 0.005 * SAMPLE_TICKS
    power = 2.0 * np.abs(np.fft.rfft(swayed - swayed.mean())) ** 2 / len(swayed) ** 2
    frequency = np.fft.rfftfreq(len(swayed), tick_s)
    base = 1.0 / (2.0 * STEP_S)
    middle = base * np.arange(1, multiples + 1)
    band = [np.abs(frequency - one) < base / 2 for one in middle]
    return middle, np.sqrt([power[one].sum() for one in band])


def _commands(body, gait, trial: Trial, rng: np.random.Generator, commands: int):  # type: ignore[no-untyped-def]
    """Walk until all commands are executed or the robot falls."""
    errors, true, told, slips, head_sway = [], [], [], [], []
    before = planned = None
    steps = 0
    for number in range(commands):
        body.walk(_random_command(gait, rng))
        body.start_due_step()
        push_at = -1
        if trial.pushed and number % PUSH_EVERY == PUSH_EVERY // 2:
            push_at = int(rng.integers(body.ticks_left))
            angle = rng.uniform(0.0, 2.0 * math.pi)
            force = PUSH_N * np.array([math.cos(angle), math.sin(angle), 0.0])
        moved, stood = Pose2(), []
        while body.ticks_left > 0 and not body.fallen:
            if 0 <= push_at < SAMPLE_TICKS:
                body.push(force, PUSH_S)
            push_at -= SAMPLE_TICKS
            moved = moved @ body.advance(min(SAMPLE_TICKS, body.ticks_left)).motion
            head_sway.append(_head(body))
            if body.swinging:
                foot, _ = body.feet_body[0 if body.swinging < 0 else 1]
                stood.append(body.true_pose @ foot)
        if body.fallen:
            break
        steps += 1
        if stood:  # none in the first step, which shifts the weight only
            slip = stood[0].inverse() @ stood[-1]
            slips.append((math.hypot(slip.x, slip.y), abs(slip.yaw)))
        now, plan = body.true_pose, body.planned_pose
        if before is not None and planned is not None:
            true_step, commanded_step = before.inverse() @ now, planned.inverse() @ plan
            errors.append((commanded_step.inverse() @ true_step).vector)
            true.append(true_step.vector)
            told.append(moved.vector)
        before, planned = now, plan
    three = (np.array(one).reshape(-1, 3) for one in (errors, true, told))
    return steps, *three, np.array(slips).reshape(-1, 2), np.array(head_sway)


def _random_command(gait, rng: np.random.Generator) -> WalkCommand:  # type: ignore[no-untyped-def]
    turn = math.radians(gait.turn_limit_deg)
    return WalkCommand(
        float(rng.uniform(-gait.backward_limit_m, gait.forward_limit_m)),
        float(rng.uniform(-gait.lateral_limit_m, gait.lateral_limit_m)),
        float(rng.uniform(-turn, turn)),
    )


def _head(body) -> list[float]:  # type: ignore[no-untyped-def]
    """Roll, pitch, yaw, height and lateral position of the head, relative to vertical and to the feet."""
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


def _table(found: list[WalkResult], standard: list[WalkResult], commands: int) -> list[str]:
    lines = [f"{len(found)} walks of {commands} random commands"]
    fallen = [one for one in found if one.fallen]
    lines += [f"  {one.trial}: seed {one.seed} fell in step {one.steps + 1}" for one in fallen]
    lines.append(
        "standard deviation of the head's sway around each multiple of the walk's frequency"
    )
    complete = [one.head for one in standard if not one.fallen]
    if not complete:
        return lines
    for name, unit, column in CHANNELS:
        bands = [spectrum(head[:, column], 6) for head in complete]
        mean = unit * np.sqrt(np.mean([power**2 for _, power in bands], axis=0))
        if column == 0:
            heads = "".join(f"{f:8.2f}" for f in bands[0][0])
            lines.append(f"  {'Hz':<18}{heads}")
        lines.append(f"  {name:<18}" + "".join(f"{value:8.2f}" for value in mean))
    return lines


EXPERIMENT = Experiment(
    id="walking",
    title="The dynamic walk on bumps and slopes and under pushes: falls, step errors, sway of the head",
    run=run,
    body="dynamic",
    targets={
        "falls": Target("==", 0.0),
        "falls_4mm": Target("<=", 1.0),
        "falls_slope": Target("==", 0.0),
        "falls_pushed": Target("==", 0.0),
        "realtime_factor": Target(">=", 8.0),
    },
    published={  # walking trials with a body of this size
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
