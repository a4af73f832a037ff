"""The same walks in PyBullet and in MuJoCo: what works must not be the friction of one engine.

The same homes are walked by the whole stack with the dynamic body, with the engine of its physics changed and nothing
else. The stack's noise of step odometry was measured in PyBullet and is not told of the other engine; the NEES of the
pose says whether its claims hold there too. Random commands on an empty floor compare the walk itself: slip of the
stance foot, step errors, sway of the head, and the error of odometry over a metre of path.

The servos and contacts of MuJoCo were chosen on the empty floor, on walks with seeds 0 to 6 and pushes with seeds 0 to
23. Homes and floors here have the seeds from 2000 on.

Source: ours.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from perception.filtering.consistency import band
from perception.primitives.errors import InputError
from perception.primitives.pose import Pose2
from planning.planners.mission import MissionConfig
from sim.body.dynamic import engines
from sim.body.dynamic.physics import ENGINES

from ...config.schema import Config
from ...evaluation.metrics.averages import rms
from ..support.experiment import Experiment, Outcome, Say, Target
from ..support.trials import run_all
from ..support.walks import ROW, column, falls_and_contacts, row, walk_all, walk_figures
from . import walking
from .humanoid_walks import step_errors
from .people_home import config_of

FIRST_SEED = 2000
COMMANDS = 100
METRE = 1.0


def home(engine: str, seed: int, limit_s: float = MissionConfig.time_limit_s) -> Config:
    """Configuration of a walk in the home of a seed, with the body's physics in an engine."""
    config = config_of(seed, limit_s=limit_s)
    dynamic = replace(config.robot.dynamic, engine=engine)
    return replace(config, robot=replace(config.robot, dynamic=dynamic))


def run(
    seeds: int,
    say: Say,
    body: str = "dynamic",
    commands: int = COMMANDS,
    limit_s: float = MissionConfig.time_limit_s,
) -> Outcome:
    """Both engines: so many commands on an empty floor, then the home of each seed, at most `limit_s` long.

    Raises:
        InputError: The body is not "dynamic".
        SurefootError: An engine is not installed.
    """
    if body != "dynamic":
        raise InputError(
            f"experiment two-physics: body={body} needs no physics engine; "
            "use --body dynamic, or omit the option"
        )
    for engine in ENGINES:
        engines.require(engine)
    numbers = range(FIRST_SEED, FIRST_SEED + seeds)
    paced = run_all(
        walking.walk,
        [
            (walking.Trial(engine, engine=engine), seed, commands)
            for engine in ENGINES
            for seed in numbers
        ],
        say,
        "walks on an empty floor",
    )
    homes = walk_all(
        [home(engine, seed, limit_s) for engine in ENGINES for seed in numbers],
        say,
        falls_and_contacts,
    )
    low, high = band(3, seeds)
    own: dict[str, dict[str, float]] = {}
    table = [f"engine    seed  {ROW}"]
    for k, engine in enumerate(ENGINES):
        walked = homes[k * seeds : (k + 1) * seeds]
        own[engine] = walk_figures(walked) | walk_quality(paced[k * seeds : (k + 1) * seeds])
        own[engine]["contacts"] = float(np.sum(column(walked, "contacts")))
        own[engine]["anees_in_band"] = float(low <= own[engine]["anees_pose"] <= high)
        table += [
            f"{engine:8}  {seed:4d}  {row(metrics)}"
            for seed, metrics in zip(numbers, walked, strict=True)
        ]
    first, second = (own[engine] for engine in ENGINES)
    ratios = [
        max(first[name], second[name]) / min(first[name], second[name])
        for name in ("position_rmse_m", "heading_rmse_deg")
    ]
    figures = {
        "contacts": first["contacts"] + second["contacts"],
        "falls": first["falls"] + second["falls"],
        "falls_empty_floor": first["falls_empty_floor"] + second["falls_empty_floor"],
        "pose_error_ratio_max": max(ratios),
    }
    figures |= {f"{name}_{engine}": own[engine][name] for name in first for engine in ENGINES}
    table += ["", f"{'':28}  {ENGINES[0]:>9}  {ENGINES[1]:>9}"]
    table += [f"{name:28}  {first[name]:9.4g}  {second[name]:9.4g}" for name in first]
    table.append(f"95 % band of the mean NEES over {seeds} homes: {low:.2f} to {high:.2f}")
    return Outcome(figures, table)


def walk_quality(walks: Sequence[walking.WalkResult]) -> dict[str, float]:
    """Slip, step errors, odometry and sway of walks with random commands."""
    slips = np.concatenate([one.slips for one in walks])
    steps = np.concatenate([step_errors(one.told, one.true) for one in walks])
    drift = np.concatenate([drift_per_metre(one.told, one.true) for one in walks])
    head = np.concatenate([one.head - one.head.mean(axis=0) for one in walks])
    return {
        "falls_empty_floor": float(sum(one.fallen for one in walks)),
        "slip_per_step_mm": 1e3 * float(slips[:, 0].mean()),
        "slip_per_step_deg": math.degrees(float(slips[:, 1].mean())),
        "untold_per_step_mean_mm": 1e3 * float(steps[:, 0].mean()),
        "untold_per_step_std_mm": 1e3 * float(steps[:, 0].std()),
        "untold_turn_std_deg": math.degrees(float(steps[:, 2].std())),
        "odometry_error_per_metre_mm": 1e3 * rms(drift[:, 0]),
        "odometry_error_per_metre_deg": math.degrees(rms(drift[:, 1])),
        "head_roll_std_deg": math.degrees(float(head[:, 0].std())),
        "head_pitch_std_deg": math.degrees(float(head[:, 1].std())),
        "head_sideways_std_mm": 1e3 * float(head[:, 4].std()),
    }


def drift_per_metre(
    told: Float[np.ndarray, "n 3"], true: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "m 2"]:
    """Error of odometry after each whole metre of path: distance, m, and heading, rad.

    Args:
        told, true: Steps by odometry and in truth, m, m, rad; a rest shorter than a metre is left out.
    """
    found, length = [], 0.0
    by_odometry, in_truth = Pose2(), Pose2()
    for one, other in zip(told.tolist(), true.tolist(), strict=True):
        by_odometry, in_truth = by_odometry @ Pose2(*one), in_truth @ Pose2(*other)
        length += math.hypot(other[0], other[1])
        if length >= METRE:
            error = in_truth.inverse() @ by_odometry
            found.append((math.hypot(error.x, error.y), error.yaw))
            by_odometry, in_truth, length = Pose2(), Pose2(), 0.0
    return np.array(found).reshape(-1, 2)


EXPERIMENT = Experiment(
    id="two-physics",
    title="The same homes and walks with the dynamic body in PyBullet and in MuJoCo",
    run=run,
    body="dynamic",
    targets={
        "contacts": Target("==", 0.0),
        "falls": Target("==", 0.0),
        "falls_empty_floor": Target("==", 0.0),
        "pose_error_ratio_max": Target("<=", 1.2),
        "anees_in_band_pybullet": Target("==", 1.0),
        "anees_in_band_mujoco": Target("==", 1.0),
    },
    seeds=5,
)
