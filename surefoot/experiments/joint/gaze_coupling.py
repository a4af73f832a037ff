"""The benefit of gaze control: gaze by evaluations, a fixed sweep and a fixed head on the same courses.

The courses are the first legs of those of seed 001: sixteen obstacles, four of them moving, and tags on the walls.
Tracker, egocentric grid, localiser and planner are the product's; only images are replaced by geometry
(`support/geometric_perception.py`). Measured after every footstep: the standard deviation of the robot's position, that of each moving
obstacle within two metres (for one without a track, the tracker's limit), and the share of outdated cells in the
sampling region.

Source: specification, INT-2; Yoo and Kim 2010 (seed 001), section 3.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from perception.primitives import plugins
from perception.primitives.gaussian import deviation
from perception.primitives.pose import Pose2
from planning.gaze.attention import sample_region
from planning.gaze.policy import POLICIES
from planning.planners.field_planner import FieldPlanner
from planning.planners.search_planner import SearchPlanner
from planning.world_model import WorldModel
from sim.robot import SimulatedRobot
from sim.scenes import catalogue
from sim.world import World

from ...config.presets import on_body
from ...config.schema import Config
from ...evaluation.metrics.averages import mean
from ...evaluation.metrics.contacts import BODY_RADIUS_M
from ...run.bodies import LiveBody
from ...run.loop import cycles
from ...run.simulate import known_beforehand, true_start
from ..support.columns import Row
from ..support.course_runner import course_config, published
from ..support.experiment import Experiment, Outcome, Say, Target
from ..support.geometric_perception import GeometricPerception
from ..support.trials import run_all

SCENE = "course"
WALKER = "walker"  # seed 001's gaze and motion, `univector.mode` "seed"
LEGS = 3  # of the course, about 9 m
LIMIT_S = 240.0
NEAR_M = 2.0  # moving obstacles within this distance are evaluated


@dataclass(frozen=True)
class GazeWalk:
    """Result of one walk, means over its steps.

    Args:
        sigma_m: Standard deviation of the robot's position along its worst axis.
        mover_sigma_m: The same of moving obstacles nearby; NaN if none came near.
        stale: Share of outdated cells in the sampling region.
        error_m: Error of the robot's position.
        mover_error_m: Error of the position of moving obstacles nearby; for one without a track the tracker's limit.
        travel_rad: Way of the head, pan and tilt together.
        contacts: Number of contacts.
        time_s: Duration.
        arrived: Whether the robot completed all legs.
        fell: Whether the robot fell, which ends the walk.
    """

    sigma_m: float
    mover_sigma_m: float
    stale: float
    error_m: float
    mover_error_m: float
    travel_rad: float
    contacts: int
    time_s: float
    arrived: bool
    fell: bool = False


def walk_with_gaze(
    seed: int,
    mode: str,
    body: str = "kinematic",
    scene_name: str = SCENE,
    limit_s: float = LIMIT_S,
) -> GazeWalk:
    """Simulate one walk with one gaze policy, or of seed 001's own walker (`WALKER`)."""
    base = on_body(course_config(scene_name, seed), body)
    if mode == WALKER:
        config = published(base)
    else:
        config = replace(base, gaze=replace(base.gaze, mode=mode))
    scene = catalogue.load(scene_name, seed)
    goals = scene.goals[:LEGS]
    config = replace(config, mission=replace(config.mission, goals=LEGS, time_limit_s=limit_s))
    found: list[tuple[float, ...]] = []
    heads: list[tuple[float, float]] = []
    contacts, touched = 0, set[int]()
    placed = replace(scene, start=true_start(scene, config))
    with (
        World(placed, "tiny", seed) as world,
        SimulatedRobot(world, config.robot, seed) as robot,
    ):
        perception = GeometricPerception(config, robot, known_beforehand(scene, robot, config))
        walker = FieldPlanner if mode == WALKER else SearchPlanner
        planner = walker(config.planning, goals)
        watch = getattr(planner.gaze.policy, "watch", None)
        if watch is not None:  # an oracle
            watch(perception)
        for cycle in cycles(LiveBody(robot), perception, planner, limit_s=limit_s):
            true = perception.truth.robot_pose()
            gaps = np.hypot(perception.discs[:, 0] - true.x, perception.discs[:, 1] - true.y)
            now = set(np.flatnonzero(gaps - perception.discs[:, 2] - BODY_RADIUS_M <= 0.0).tolist())
            contacts += len(now - touched)
            touched = now
            if cycle.decision is not None:
                heads.append(perception.head(true))
            if cycle.decision is not None and cycle.decision.why != "survey":
                found.append(
                    _measures(perception, cycle.world, true, len(scene.moving_objects), config)
                )
        table = np.array(found or [(math.nan,) * 5])
        sigma, mover, stale, error, off = (_mean(values) for values in table.T)
        return GazeWalk(
            *(sigma, mover, stale, error, off),
            float(np.abs(np.diff(heads, axis=0)).sum()),
            contacts,
            world.stamp_s,
            planner.reached == len(goals) and not robot.fallen,
            robot.fallen,
        )


def _measures(
    perception: GeometricPerception, world: WorldModel, true: Pose2, movers: int, config: Config
) -> tuple[float, ...]:
    """The first five figures of `GazeWalk` after one step."""
    assert world.pose is not None
    assert perception.grid is not None
    assert perception.confidence is not None
    lost = config.tracker.largest_sigma_m
    near, off = [], []
    for x, y, radius in perception.discs[:movers]:
        if math.hypot(x - true.x, y - true.y) > NEAR_M:
            continue
        tracks = [o for o in world.tracks if np.hypot(*(o.position - (x, y))) < 3.0 * radius]
        sigmas = [deviation(o.state.covariance[:2, :2]) for o in tracks]
        near.append(min(sigmas, default=lost))
        off.append(min((float(np.hypot(*(o.position - (x, y)))) for o in tracks), default=lost))
    region = config.gaze.map
    _, confidence = sample_region(perception.grid, perception.confidence, world.pose, region)
    return (
        deviation(world.pose.covariance[:2, :2]),
        mean(near),
        float(np.mean(confidence < config.confidence.stale_below)),
        math.hypot(*(world.pose.mean[:2] - (true.x, true.y))),
        mean(off),
    )


def _mean(values: Float[np.ndarray, "n"]) -> float:
    """Mean of the finite values; NaN without any."""
    return mean(values[np.isfinite(values)])


def run(seeds: int, say: Say, body: str = "kinematic", own: str = "") -> Outcome:
    """One walk per gaze policy and seed; about ten seconds of one core each.

    Args:
        seeds: Number of courses.
        say: Takes lines of progress.
        body: Body that walks.
        own: The user's own gaze policy, "package.module:Class", beside ours; empty: none.
    """
    modes = [*POLICIES, WALKER]
    if own:
        plugins.load(own, POLICIES, "gaze policy", ("next",))  # refused before the first walk
        modes.append(own)
    todo = [(seed, mode, body) for seed in range(seeds) for mode in modes]
    found: dict[str, list[GazeWalk]] = {mode: [] for mode in modes}
    for (_, mode, _), one in zip(todo, run_all(walk_with_gaze, todo, say, "walks"), strict=True):
        found[mode].append(one)
    means = {
        mode: {
            name: float(np.nanmean([getattr(one, name) for one in walks]))
            for name in GazeWalk.__dataclass_fields__
        }
        for mode, walks in found.items()
    }
    figures = {}
    for other, ending in (("fixed", ""), ("sweep", "_against_sweep")):
        for name in ("sigma", "mover_sigma", "stale"):
            key = name if name == "stale" else f"{name}_m"
            less = 1.0 - means["evaluations"][key] / means[other][key]
            figures[f"{name}_reduction{ending}_pct"] = 100.0 * less
    table = [
        "             sigma mm  moving obstacles mm  outdated %  contacts  falls  free %  arrived %  time s"
    ]
    for policy, values in means.items():
        walks, mode = found[policy], plugins.label(policy)
        figures[f"contacts_{mode}"] = float(sum(one.contacts for one in walks))
        figures[f"falls_{mode}"] = float(sum(one.fell for one in walks))
        figures[f"contact_free_share_{mode}"] = float(np.mean([w.contacts == 0 for w in walks]))
        figures[f"arrived_share_{mode}"] = values["arrived"]
        figures[f"time_s_{mode}"] = values["time_s"]
        figures[f"sigma_mm_{mode}"] = 1e3 * values["sigma_m"]
        figures[f"mover_sigma_mm_{mode}"] = 1e3 * values["mover_sigma_m"]
        figures[f"stale_pct_{mode}"] = 100.0 * values["stale"]
        table.append(
            f"{mode:<12.12} {1e3 * values['sigma_m']:8.1f}  {1e3 * values['mover_sigma_m']:19.0f}"
            f"  {100 * values['stale']:10.1f}  {figures[f'contacts_{mode}']:8.0f}"
            f"  {figures[f'falls_{mode}']:5.0f}"
            f"  {100 * figures[f'contact_free_share_{mode}']:6.0f}  {100 * values['arrived']:9.0f}"
            f"  {values['time_s']:6.1f}"
        )
    figures["falls"] = float(sum(one.fell for walks in found.values() for one in walks))
    figures["contacts_above_sweep"] = figures["contacts_evaluations"] - figures["contacts_sweep"]
    rows = [*_rows("its gaze", "seed"), *_rows("gaze and motion", WALKER)]
    return Outcome(figures, table, rows)


def _rows(what: str, mode: str) -> list[Row]:
    """Rows of the table of three columns with the figures of one published mode."""
    names = {
        "deviation of the robot, mm": "sigma_mm",
        "deviation of moving obstacles, mm": "mover_sigma_mm",
        "outdated ground, %": "stale_pct",
        "contacts": "contacts",
        "all via points reached, share": "arrived_share",
        "time, s": "time_s",
    }
    return [
        (f"{what}: {words}", None, f"{one}_{mode}", f"{one}_evaluations")
        for words, one in names.items()
    ]


EXPERIMENT = Experiment(
    id="INT-2",
    title="Gaze by evaluations (Yoo and Kim 2010) against a fixed sweep and a fixed head, on the same courses",
    run=run,
    body="kinematic",
    plug_in="gaze",
    targets={
        "sigma_reduction_pct": Target(">=", 30.0),
        "stale_reduction_pct": Target(">=", 50.0),
        "sigma_reduction_against_sweep_pct": Target(">", 0.0),
        "stale_reduction_against_sweep_pct": Target(">", 0.0),
        "mover_sigma_reduction_pct": Target(">=", 30.0),
        "mover_sigma_reduction_against_sweep_pct": Target(">", 0.0),
        "contacts_above_sweep": Target("<=", 0.0),
    },
    seeds=50,
)
