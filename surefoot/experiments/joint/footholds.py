"""Footholds: the time from a map to the next steps, and the claimed chance of a missed edge against what happened.

On random stairs, kerbs and trenches, with two kinds of maps: true surfaces whose sides are off by errors drawn from
the claimed covariances, and maps that a Unitree G1 makes on its way by simulated depth images and joints. On each map soles
are put at random; the foot lands with drawn slip. An edge is missed if any part of the sole is beyond the true edge of the level
that it was meant for, or if there is no such level. Of a map every bin of claims gets one sole at most, so the outcomes of a
bin are independent, and their number must be within the binomial band.

Parameters were chosen on seeds 0 to 29; judged are seeds from 2000.

Source: ours.
"""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import binom

from mapping.ground.surface import Border, Surface
from perception.primitives.pose import Pose2
from perception.primitives.robot_model import RobotModel
from planning.footholds.foothold import FootNoise, chances
from planning.footholds.search import SLOPE, Stance, plan
from sim.scenes import stairs
from sim.scenes.stairs import Terrain

from ...config.schema import Config
from ...run.bodies import LiveBody
from ...run.loop import cycles
from ..support.experiment import Experiment, Outcome, Say, Target
from ..support.trials import run_all
from .stairs_walk import ROBOT, on_terrain

FIRST_SEED = 2000
BINS = (0.0, 0.01, 0.05, 0.2, 0.5, 1.0)
DRAWN = 20  # maps with drawn errors of a seed
LOOKED = (3, 7, 11, 15)  # decisions of a walk after which its map is judged
CANDIDATES, UNSEEN = 60, 1e-3
LEVEL_M = 0.03  # by which a surface may be off its level
SURE = 0.998  # of the binomial band


@dataclass(frozen=True)
class Trial:
    """Claims of soles and what happened, for drawn and for made maps; times of the plans, ms."""

    drawn: tuple[tuple[float, bool], ...]
    mapped: tuple[tuple[float, bool], ...]
    drawn_ms: tuple[float, ...]
    mapped_ms: tuple[float, ...]


def trial(seed: int) -> Trial:
    """All maps of a seed."""
    drawn, drawn_ms = _drawn(seed)
    mapped, mapped_ms = _mapped(seed)
    return Trial(tuple(drawn), tuple(mapped), tuple(drawn_ms), tuple(mapped_ms))


def true_surfaces(terrain: Terrain, stands: Pose2, sigma_m: np.ndarray) -> list[Surface]:
    """The levels as surfaces in the frame of a foot, each side with its deviation: right, front, left, back."""
    found = []
    to_foot = stands.inverse()
    ground_m = height(terrain, stands.x)
    heights = [0.0, *(one.height_m for one in terrain.levels), 0.0]
    for k, one in enumerate(terrain.levels):
        x, y = (one.start_m, one.end_m), terrain.half_m
        corners = np.array([[x[0], -y], [x[1], -y], [x[1], y], [x[0], y]])
        ahead, behind = (
            Border.RISE if heights[j] > one.height_m else Border.DROP for j in (k + 2, k)
        )
        borders = np.array([Border.DROP, ahead, Border.DROP, behind], int)
        middle = to_foot.apply(corners.mean(axis=0))
        plane = np.array([one.height_m - ground_m, 0.0, 0.0])
        found.append(
            Surface(middle, plane, 9e-6 * np.eye(3), to_foot.apply(corners), borders, sigma_m[k])
        )
    return found


def shifted(surface: Surface, out_m: np.ndarray) -> Surface:
    """A surface with four sides, each moved outwards."""
    start, end = surface.outline, np.roll(surface.outline, -1, axis=0)
    along = (end - start) / np.linalg.norm(end - start, axis=1, keepdims=True)
    normal = np.stack([along[:, 1], -along[:, 0]], axis=1)
    offset = np.einsum("ij,ij->i", normal, start) + out_m
    corners = [
        np.linalg.solve(np.stack([normal[k - 1], normal[k]]), offset[[k - 1, k]]) for k in range(4)
    ]
    return Surface(
        surface.origin, surface.height, surface.covariance, np.array(corners), surface.borders,
        surface.sigma_m,
    )  # fmt: skip


def height(terrain: Terrain, x: float) -> float:
    """Height of the level at x, m."""
    return next(one.height_m for one in terrain.levels if one.start_m <= x < one.end_m)


def missed(terrain: Terrain, sole: Pose2, height_m: float, robot: RobotModel) -> bool:
    """Whether a part of a sole in the world is beyond the level that is meant."""
    half = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]]) * np.array(robot.foot_m) / 2
    corners = sole.apply(half)
    if abs(height_m) < LEVEL_M:  # the floor, which is wherever no level is
        return any(
            one.height_m > 0.0 and one.start_m < x < one.end_m and abs(y) < terrain.half_m
            for one in terrain.levels
            for x, y in corners
        )
    for one in terrain.levels:
        if one.start_m <= sole.x < one.end_m and abs(one.height_m - height_m) < LEVEL_M:
            x, y = corners.T
            off = (x < one.start_m) | (x > one.end_m) | (np.abs(y) > terrain.half_m)
            return bool(off.any())
    return True


def _claims(
    rng: np.random.Generator,
    surfaces: Sequence[Surface],
    terrain: Terrain,
    stands: Pose2,
    robot: RobotModel,
    noise: FootNoise,
) -> list[tuple[float, bool]]:
    """At most one sole in every bin: its claim, and whether it missed an edge."""
    level = [one for one in surfaces if math.hypot(*one.height[1:]) < SLOPE]
    level_m = height(terrain, stands.x)
    found: dict[int, tuple[float, bool]] = {}
    for _ in range(CANDIDATES):
        surface = level[int(rng.integers(len(level)))]
        weights = rng.dirichlet(np.ones(len(surface.outline)))
        x, y = weights @ surface.outline
        pose = Pose2(float(x), float(y), float(rng.uniform(-0.3, 0.3)))
        claimed, unseen = chances(surface, pose, robot, noise)
        if unseen > UNSEEN or claimed >= 1.0 or math.hypot(pose.x, pose.y) > 1.2:
            continue
        where = int(np.searchsorted(BINS, claimed, side="right"))
        if where in found:
            continue
        slip = Pose2(*(float(v) for v in np.sqrt(noise.variances) * rng.standard_normal(3)))
        height_m = float(surface.height_at(np.array([x, y]))[0]) + level_m
        sole = stands @ pose @ slip
        found[where] = claimed, missed(terrain, sole, height_m, robot)
    return list(found.values())


def _timed(
    surfaces: Sequence[Surface], foot: int, goal: np.ndarray, robot: RobotModel, noise: FootNoise
) -> float:
    """Processor time of a plan, ms."""
    began_s = time.thread_time()
    plan(surfaces, Stance(foot, Pose2()), goal, 0.25, robot, noise)
    return 1e3 * (time.thread_time() - began_s)


def _drawn(seed: int) -> tuple[list[tuple[float, bool]], list[float]]:
    """Maps with errors drawn from their covariances."""
    robot = Config(robot=ROBOT).robot_model
    rng, noise = np.random.default_rng([seed, 61]), FootNoise(0.0016, 0.0007, math.radians(0.7))
    claims: list[tuple[float, bool]] = []
    times = []
    for number in range(DRAWN):
        kind = stairs.KINDS[number % len(stairs.KINDS)]
        terrain = stairs.terrain(kind, 1000 * seed + number)
        last = terrain.levels[-1].end_m
        stands = Pose2(rng.uniform(0.0, last - 1.5), rng.uniform(-0.2, 0.2), rng.uniform(-0.2, 0.2))
        sigma = rng.uniform(0.004, 0.02, (len(terrain.levels), 4))
        true = true_surfaces(terrain, stands, sigma)
        made = [shifted(one, one.sigma_m * rng.standard_normal(4)) for one in true]
        claims += _claims(rng, made, terrain, stands, robot, noise)
        goal = stands.inverse().apply(np.array([last - 0.75, 0.0]))
        times.append(_timed(made, int(rng.choice([-1, 1])), goal, robot, noise))
    return claims, times


def _mapped(seed: int) -> tuple[list[tuple[float, bool]], list[float]]:
    """Maps of a walk over the terrain that is the seed's turn."""
    kind = stairs.KINDS[seed % len(stairs.KINDS)]
    rng = np.random.default_rng([seed, 62])
    claims: list[tuple[float, bool]] = []
    times = []
    with on_terrain(kind, seed) as (terrain, robot, pipeline, planner):
        config, number = pipeline.config, 0
        live, limit_s = LiveBody(robot), config.mission.time_limit_s
        for cycle in cycles(live, pipeline, planner, config.robot_model, limit_s):
            levels, decision = cycle.world.levels, cycle.decision
            if decision is None or levels is None:
                continue
            times.append(decision.timing_ms["plan"])
            foot, _ = robot.body.feet_body[0 if levels.foot > 0 else 1]
            stands = robot.body.true_pose @ foot
            if number in LOOKED:
                noise = FootNoise(*levels.step_sigma.tolist())
                claims += _claims(rng, levels.surfaces, terrain, stands, config.robot_model, noise)
            number += 1
            if number > LOOKED[-1]:
                break
    return claims, times


def run(seeds: int, say: Say) -> Outcome:
    """One trial per seed."""
    todo = [(FIRST_SEED + k,) for k in range(seeds)]
    return Outcome(*summary(run_all(trial, todo, say, "seeds")))


def summary(found: Sequence[Trial]) -> tuple[dict[str, float], list[str]]:
    """Figures and table."""
    figures: dict[str, float] = {}
    lines = ["map     claimed          soles  missed  expected  band"]
    fits = []
    for name in ("drawn", "mapped"):
        claims = np.array([c for one in found for c in getattr(one, name)], float).reshape(-1, 2)
        good = True
        for low, high in itertools.pairwise(BINS):
            p, happened = claims[(claims[:, 0] >= low) & (claims[:, 0] < high)].T
            if not len(p):
                continue
            band = binom.interval(SURE, len(p), float(np.clip(p.mean(), 1e-12, 1.0)))
            inside = band[0] <= happened.sum() <= band[1]
            good &= bool(inside)
            lines.append(
                f"{name:<7} {low:4.2f} to {high:4.2f} {len(p):9d} {happened.sum():7.0f} {p.sum():9.1f}"
                f"  {band[0]:.0f} to {band[1]:.0f}{'' if inside else '  out'}"
            )
        fits.append(good)
        figures[f"{name}_in_band"] = float(good)
        ms = [value for one in found for value in getattr(one, f"{name}_ms")]
        figures[f"{name}_plan_ms_p50"], figures[f"{name}_plan_ms_p99"] = (
            float(np.percentile(ms, share)) for share in (50, 99)
        )
    figures["missed_in_band"] = float(all(fits))
    figures["plan_ms_p99"] = max(figures["drawn_plan_ms_p99"], figures["mapped_plan_ms_p99"])
    return figures, lines


EXPERIMENT = Experiment(
    id="footholds",
    title="Footholds on several levels: time of a plan, and the claimed chance of a missed edge against what happened",
    run=run,
    targets={"plan_ms_p99": Target("<=", 20.0), "missed_in_band": Target("==", 1.0)},
    seeds=60,
)
