"""Does it pay to choose where to look: evaluations, a fixed sweep and a fixed head on the same courses.

Sixteen obstacles, four of them moving, and tags on the walls: the first legs of the course of seed 001. Tracker,
terrain map, localiser and planner are the product's; only pictures are left out (`course_senses`), and the
robot finds itself by the tags that its colour camera would show, with the deviations that sightings in
pictures claim. After every footstep that is walked: the deviation of the robot's place, that of each mover within
two metres (of one without a track, what the tracker gives up at), and the share of stale ground in the seed's
sampling region.

Source: the integration experiment INT-2; seed 001, section 3.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from perception.localisation.filter import PoseFilter
from perception.primitives import plugins
from perception.primitives.frame import Frame
from perception.primitives.gaussian import Gaussian
from perception.primitives.landmark import Sighting
from perception.primitives.pose import Pose2
from planning.gaze import evaluations
from planning.gaze.attention import sample_region
from planning.gaze.policy import POLICIES
from planning.planners.search_planner import SearchPlanner
from planning.world_model import WorldModel
from sim.robot import SimulatedRobot
from sim.scenes import catalogue
from sim.sensors.geometric_sensor import COLOUR_DEG
from sim.world import World

from ...config.presets import on_body
from ...config.schema import Config
from ...run.bodies import LiveBody
from ...run.loop import cycles
from ...run.simulate import START_COVARIANCE
from ..support.course_runner import course_config
from ..support.experiment import Experiment, Outcome, Say, Target
from ..support.geometric_perception import GeometricPerception
from ..support.trials import run_trials

SCENE = "course"
LEGS = 3  # of the course, about 9 m
LIMIT_S = 240.0
NEAR_M = 2.0  # movers nearer than this should be known
BODY_M = 0.15  # S_r: a contact is the study's
REACH_M = 3.5  # of a tag, side of 0.22 m
ASLANT_RAD = math.radians(65.0)  # more, and the tag cannot be read
RANGE_PER_M = 0.0033  # deviation of a range by its square: what sightings in pictures claim
BEARING_RAD = 0.0071  # the same of a bearing


@dataclass(frozen=True)
class GazeWalk:
    """What came of one walk, means over its steps.

    Args:
        sigma_m: Deviation of the robot's place along its worst axis.
        mover_sigma_m: The same of the movers near; NaN if none came near.
        stale: Share of the sampling region.
        contacts: With anything.
        time_s: When it ended.
        arrived: Whether all legs were walked.
        fell: Whether the robot fell, which ends a walk.
    """

    sigma_m: float
    mover_sigma_m: float
    stale: float
    contacts: int
    time_s: float
    arrived: bool
    fell: bool = False


class LocalisedPerception(GeometricPerception):
    """Geometric perception whose pose comes from the localiser, by odometry, gyro and the tags in view."""

    def __init__(self, config: Config, robot: SimulatedRobot, seed: int) -> None:
        super().__init__(config, robot, seed, perfect=False)
        scene = robot.world.scene
        self.landmarks = scene.landmarks
        self.localiser = PoseFilter(
            Gaussian(scene.start.vector, START_COVARIANCE), scene.landmarks, config.localiser
        )
        self._noise = np.random.default_rng([seed, 41])

    def _estimated(self, frame: Frame, true: Pose2, elapsed: float) -> Gaussian:
        """The localiser's pose."""
        self.localiser.predict(frame.odometry, frame.imu, elapsed)
        self._sightings = tuple(self._look_for_tags(true)) if frame.footstep_due else ()
        self.localiser.update(self._sightings)
        return self.localiser.pose

    def _look_for_tags(self, true: Pose2) -> list[Sighting]:
        """The tags that the colour camera shows, not hidden and not too aslant."""
        half = math.radians(COLOUR_DEG) / 2
        pan, _ = self._head(true)
        found = []
        for mark in self.landmarks:
            x, y = true.inverse().apply(np.array([mark.position[:2]]))[0]
            away, bearing = math.hypot(x, y), math.atan2(y, x)
            off = abs((bearing - pan + math.pi) % (2 * math.pi) - math.pi)
            if away > REACH_M or off > half - 0.11 / away:
                continue
            ray = np.array([[true.x, true.y, true.yaw + bearing]])
            if self._aslant(np.array(mark.position[:2]), ray[0, 2]) > ASLANT_RAD:
                continue
            if self._sensor.rays(self.discs, self._walls, ray)[0][0] < away - 0.1:
                continue
            sigmas = np.array([RANGE_PER_M * away**2, BEARING_RAD])
            measured = np.array([away, bearing]) + sigmas * self._noise.standard_normal(2)
            found.append(Sighting(mark.identity, measured, np.diag(sigmas**2)))
        return found

    def _aslant(self, place: Float[np.ndarray, "2"], direction_rad: float) -> float:
        """Angle between the line of sight and the normal of the wall that a tag hangs on."""
        x0, y0, x1, y1 = self._walls
        gaps = np.array([place[0] - x0, x1 - place[0], place[1] - y0, y1 - place[1]])
        across = abs(math.cos(direction_rad)) if gaps.argmin() < 2 else abs(math.sin(direction_rad))
        return math.acos(min(across, 1.0))


def walk_with_gaze(
    seed: int, mode: str, body: str = "kinematic", scene_name: str = SCENE
) -> GazeWalk:
    """One walk with one way of looking."""
    base = on_body(course_config(scene_name, seed), body)
    config = replace(base, gaze=replace(base.gaze, mode=mode))
    scene = catalogue.load(scene_name, seed)
    goals = scene.goals[:LEGS]
    config = replace(config, mission=replace(config.mission, goals=LEGS, time_limit_s=LIMIT_S))
    found: list[tuple[float, float, float]] = []
    contacts, touching = 0, set[int]()
    with (
        World(scene, "tiny", seed) as world,
        SimulatedRobot(world, config.robot, seed) as robot,
    ):
        perception = LocalisedPerception(config, robot, seed)
        planner = SearchPlanner(config.planning, goals)
        for cycle in cycles(LiveBody(robot), perception, planner):
            true = perception.truth.robot_pose()
            gaps = np.hypot(perception.discs[:, 0] - true.x, perception.discs[:, 1] - true.y)
            now = set(np.flatnonzero(gaps - perception.discs[:, 2] - BODY_M <= 0.0).tolist())
            contacts += len(now - touching)
            touching = now
            if cycle.decision is not None and cycle.decision.why != "survey":
                found.append(
                    _measures(perception, cycle.world, true, len(scene.moving_objects), config)
                )
        sigma, mover, stale = np.array(found or [(math.nan,) * 3]).T
        return GazeWalk(
            float(sigma.mean()),
            float(np.nanmean(mover)) if np.isfinite(mover).any() else math.nan,
            float(stale.mean()),
            contacts,
            world.stamp_s,
            planner.reached == len(goals) and not robot.fallen,
            robot.fallen,
        )


def _measures(
    perception: LocalisedPerception, world: WorldModel, true: Pose2, movers: int, config: Config
) -> tuple[float, float, float]:
    """Deviation of the place, mean of those of the movers near, stale share."""
    assert world.pose is not None
    assert perception.grid is not None
    assert perception.confidence is not None
    lost = config.tracker.largest_sigma_m
    near = []
    for x, y, radius in perception.discs[:movers]:
        if math.hypot(x - true.x, y - true.y) > NEAR_M:
            continue
        tracks = [o for o in world.tracks if np.hypot(*(o.position - (x, y))) < 3.0 * radius]
        sigmas = [evaluations.deviation(o.state.covariance[:2, :2]) for o in tracks]
        near.append(min(sigmas, default=lost))
    region = config.gaze.map
    _, confidence = sample_region(perception.grid, perception.confidence, world.pose, region)
    return (
        evaluations.deviation(world.pose.covariance[:2, :2]),
        float(np.mean(near)) if near else math.nan,
        float(np.mean(confidence < config.confidence.stale_below)),
    )


def run(seeds: int, say: Say, body: str = "kinematic", own: str = "") -> Outcome:
    """Three walks a seed; about ten seconds of one core each.

    Args:
        seeds: Number of courses.
        say: Progress.
        body: That walks.
        own: A gaze policy of the user's, "package.module:Class", beside ours; empty: none.
    """
    modes = [*POLICIES]
    if own:
        plugins.load(own, POLICIES, "gaze policy", ("next",))  # refused before anything walks
        modes.append(own)
    todo = [(seed, mode, body) for seed in range(seeds) for mode in modes]
    found: dict[str, list[GazeWalk]] = {mode: [] for mode in modes}
    for (_, mode, _), one in zip(todo, run_trials(walk_with_gaze, todo), strict=True):
        found[mode].append(one)
        say(f"{sum(map(len, found.values()))} of {len(todo)} walks")
    mean = {
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
            less = 1.0 - mean["evaluations"][key] / mean[other][key]
            figures[f"{name}_reduction{ending}_pct"] = 100.0 * less
    table = [
        "             sigma mm  movers mm  stale %  contacts  falls  free %  arrived %  time s"
    ]
    for policy, values in mean.items():
        walks, mode = found[policy], plugins.label(policy)
        figures[f"contacts_{mode}"] = float(sum(one.contacts for one in walks))
        figures[f"falls_{mode}"] = float(sum(one.fell for one in walks))
        figures[f"contact_free_share_{mode}"] = float(np.mean([w.contacts == 0 for w in walks]))
        figures[f"arrived_share_{mode}"] = values["arrived"]
        figures[f"time_s_{mode}"] = values["time_s"]
        table.append(
            f"{mode:<12.12} {1e3 * values['sigma_m']:8.1f}  {1e3 * values['mover_sigma_m']:9.0f}"
            f"  {100 * values['stale']:7.1f}  {figures[f'contacts_{mode}']:8.0f}"
            f"  {figures[f'falls_{mode}']:5.0f}"
            f"  {100 * figures[f'contact_free_share_{mode}']:6.0f}  {100 * values['arrived']:9.0f}"
            f"  {values['time_s']:6.1f}"
        )
    figures["falls"] = float(sum(one.fell for walks in found.values() for one in walks))
    figures["contacts_above_sweep"] = figures["contacts_evaluations"] - figures["contacts_sweep"]
    return Outcome(figures, table)


EXPERIMENT = Experiment(
    id="INT-2",
    title="Gaze by the evaluations against a fixed sweep and a fixed head, on the same courses",
    run=run,
    body="kinematic",
    plug_in="gaze",
    targets={
        "sigma_reduction_pct": Target(">=", 30.0),
        "stale_reduction_pct": Target(">=", 50.0),
        "sigma_reduction_against_sweep_pct": Target(">", 0.0),
        "stale_reduction_against_sweep_pct": Target(">", 0.0),
        "mover_sigma_reduction_pct": Target(">=", 30.0),
        "contacts_above_sweep": Target("<=", 0.0),
    },
    seeds=50,
)
