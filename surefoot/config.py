"""One configuration made of every part's own.

Works with no file at all; reads TOML, of which any part may be left out; a run writes the complete one
beside its results, and that file runs again to the same numbers.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mapping.clouds import CloudConfig
from mapping.confidence import ConfidenceConfig
from mapping.egocentric_grid import GridConfig
from mapping.footprints import FootprintConfig
from mapping.world_map import WorldMapConfig
from perception.clusters import ClusterConfig
from perception.coloured import ColouredConfig
from perception.floor.choose import FloorConfig
from perception.floor.classify import ClassConfig
from perception.floor.refine import RefineConfig, SharedError
from perception.localisation.filter import LocaliserConfig
from perception.localisation.landmarks import LandmarkConfig
from perception.localisation.obstacles import TrackerConfig
from perception.localisation.registration import RegistrationConfig
from perception.monocular.cycle import MonocularConfig
from perception.primitives.errors import ConfigError
from perception.stereo import StereoConfig
from perception.structured_light import StructuredLightConfig
from perception.time_of_flight import TofConfig
from planning.avoidance.choice import AvoidanceConfig
from planning.exploration import ExplorationConfig
from planning.gaze.policy import GazeConfig
from planning.guard import GuardConfig
from planning.route import RouteConfig
from planning.search.potential import SearchConfig
from planning.swarm.settings import SwarmWalkerConfig
from planning.univector.fields import FieldConfig
from sim.difficulty import USUAL
from sim.difficulty import check as check_difficulty
from sim.dynamic.anatomy import DARWIN
from sim.robot import RobotConfig

from . import config_file
from .depth_trust import DepthTrustConfig
from .odometer import OdometerConfig
from .whereabouts import PriorConfig


@dataclass(frozen=True)
class ReachConfig:
    """Which part of a depth image is believed."""

    nearest_m: float = 0.15
    farthest_m: float = 3.0
    stride: int = 1  # 2 takes every second row and column

    def __post_init__(self) -> None:
        if not 0.0 <= self.nearest_m < self.farthest_m:
            raise ConfigError(
                f"reach: nearest_m={self.nearest_m} must not be negative and be below "
                f"farthest_m={self.farthest_m}"
            )
        if self.stride < 1:
            raise ConfigError(f"reach: stride={self.stride} must be at least 1")


@dataclass(frozen=True)
class ReachesConfig:
    """The reach of each kind of depth sensor."""

    tof: ReachConfig = ReachConfig(0.15, 3.0, 1)  # seed 004: 5 m wrap, noise 20 mm at 3 m
    stereo: ReachConfig = ReachConfig(
        0.20, 2.0, 2
    )  # seed 003: floor to 3 m; beyond 2 m TOF is better
    depth: ReachConfig = ReachConfig(0.30, 4.0, 2)  # Kinect kind: steps of centimetres beyond 4 m


PLANNERS = {
    "search": "navigator:Navigator",
    "field": "field_planner:FieldPlanner",
    "swarm": "swarm_planner:SwarmPlanner",
    "avoidance": "avoidance_planner:AvoidancePlanner",
}
"""Who may decide the next footstep: name to module and class of this package."""


ARRIVING = ("search", "field")
"""Those of them that walk by the univector field, which can arrive with a given heading."""

WANDERING = ("search",)
"""Those of them that explore."""


@dataclass(frozen=True)
class MissionConfig:
    """What a live run is to do."""

    planner: str = "search"  # the joint stack; see `planners`
    goals: int = 1  # how many of the scene's goals, in order
    look_about: bool = True  # specification: where the search finds no way, seed 004's motions
    wander: bool = False  # explore instead, until the time is up (seed 003, experiment E6)
    tolerance_m: float = 0.10  # seed 000: goal tolerance
    headings_deg: tuple[float, ...] = ()  # seed 001: to arrive with, one a goal; nan or none: any
    heading_tolerance_deg: float = 5.0  # seed 001, E1: arrival error
    time_limit_s: float = 300.0  # ours: a walk of 6 m takes 90 s, detours included 150 s

    def __post_init__(self) -> None:
        if self.planner not in PLANNERS:
            raise ConfigError(
                f"mission: planner={self.planner!r} is unknown; choose {', '.join(PLANNERS)}"
            )
        if self.goals < 1:
            raise ConfigError(f"mission: goals={self.goals} must be at least 1")
        for name in ("tolerance_m", "time_limit_s", "heading_tolerance_deg"):
            if not getattr(self, name) > 0.0:
                raise ConfigError(f"mission: {name}={getattr(self, name)} must be positive")
        if self.wander and self.planner not in WANDERING:
            raise ConfigError(
                f"mission: planner={self.planner!r} walks to goals; leave wander off, or choose "
                f"{' or '.join(WANDERING)}"
            )
        if any(math.isinf(heading) for heading in self.headings_deg):
            raise ConfigError(
                f"mission: headings_deg={self.headings_deg} must be finite; nan stands for any heading"
            )
        if self.headings_deg and self.planner not in ARRIVING:
            raise ConfigError(
                f"mission: planner={self.planner!r} arrives with any heading; leave headings_deg empty, or "
                f"choose {' or '.join(ARRIVING)}"
            )


CALIBRATED_TOF = TofConfig(wiggle_m=0.004, stray_share=0.02)
"""The robot's own camera as its calibration found it; another camera needs its own figures."""

CALIBRATED_FLOOR = FloorConfig(refine=RefineConfig(tof=SharedError(0.0002, 0.0003)))
"""With that calibration little is left that all points of a TOF view have wrong alike (NEES of walks)."""


BESIDE_GUARD = FieldConfig(
    gaze_coupling=False, virtual_obstacles=False, velocity_change=False, uncertainty=False
)
"""The published field alone: beside a guard its additions are the guard's business. Measured (001-E4, 100 courses):
field alone 153 contacts, with all additions 180, with the guard 1."""


@dataclass(frozen=True)
class Config:
    """Everything a run depends on."""

    scene: str = "home"
    seed: int = 0
    difficulty: float = USUAL  # ours: of the scene, in [0, 1]; see `sim.difficulty`
    renderer: str = "auto"  # egl where it works, else tiny; a run writes down which it was
    mission: MissionConfig = field(default_factory=MissionConfig)
    robot: RobotConfig = field(default_factory=RobotConfig)
    reach: ReachesConfig = field(default_factory=ReachesConfig)
    tof: TofConfig = field(default_factory=lambda: CALIBRATED_TOF)
    stereo: StereoConfig = field(default_factory=StereoConfig)
    structured_light: StructuredLightConfig = field(default_factory=StructuredLightConfig)
    floor: FloorConfig = field(default_factory=lambda: CALIBRATED_FLOOR)
    classes: ClassConfig = field(default_factory=ClassConfig)
    clusters: ClusterConfig = field(default_factory=ClusterConfig)
    coloured: ColouredConfig = field(default_factory=ColouredConfig)
    prior: PriorConfig = field(default_factory=PriorConfig)
    landmarks: LandmarkConfig = field(default_factory=LandmarkConfig)
    localiser: LocaliserConfig = field(default_factory=LocaliserConfig)
    registration: RegistrationConfig = field(default_factory=RegistrationConfig)
    tracker: TrackerConfig = field(default_factory=TrackerConfig)
    grid: GridConfig = field(default_factory=GridConfig)
    confidence: ConfidenceConfig = field(default_factory=ConfidenceConfig)
    world_map: WorldMapConfig = field(default_factory=WorldMapConfig)
    odometer: OdometerConfig = field(default_factory=OdometerConfig)
    cloud: CloudConfig = field(default_factory=CloudConfig)
    obstacle_cloud: CloudConfig = field(default_factory=CloudConfig)
    footprints: FootprintConfig = field(default_factory=FootprintConfig)
    search: SearchConfig = field(default_factory=SearchConfig)
    route: RouteConfig = field(default_factory=RouteConfig)
    exploration: ExplorationConfig = field(default_factory=ExplorationConfig)
    univector: FieldConfig = BESIDE_GUARD  # of the planner `field`, straight to the goal
    via_field: FieldConfig = BESIDE_GUARD  # of the planner `search`, to its via points
    guard: GuardConfig = field(default_factory=GuardConfig)
    monocular: MonocularConfig = field(default_factory=MonocularConfig)
    swarm: SwarmWalkerConfig = field(default_factory=SwarmWalkerConfig)
    avoidance: AvoidanceConfig = field(default_factory=AvoidanceConfig)
    gaze: GazeConfig = field(default_factory=GazeConfig)
    depth_trust: DepthTrustConfig = field(default_factory=DepthTrustConfig)

    def resolved(self, renderer: str) -> Config:
        """The same, with the renderer that was really used."""
        return dataclasses.replace(self, renderer=renderer)

    def __post_init__(self) -> None:
        if self.seed < 0:
            raise ConfigError(f"seed={self.seed} must not be negative")
        if self.swarm.as_walked.prediction == "flow" and not self.robot.image_pairs:
            raise ConfigError(
                "swarm: prediction by flow compares two pictures of one step, and the robot takes only one; "
                "set robot.image_pairs=true"
            )
        if self.mission.planner == "swarm" and not self.robot.colour:
            raise ConfigError("mission: planner='swarm' walks by colour; set robot.colour=true")
        check_difficulty(self.difficulty)
        if self.renderer not in ("auto", "egl", "tiny"):
            raise ConfigError(f"renderer={self.renderer!r} is unknown; choose auto, egl or tiny")


WALKED_LOCALISER = LocaliserConfig(
    slip_m=0.0014,
    slip_sigma_m=0.0006,
    crab_m=-0.0003,
    crab_sigma_m=0.0006,
    drift_sigma_rad=math.radians(0.25),
    step_x_sigma_m=0.0019,
    step_y_sigma_m=0.0015,
    step_yaw_sigma_rad=math.radians(1.4),
    still_sigma_m=0.003,
    still_sigma_rad=math.radians(4.0),
    shared_bearing_sigma_rad=math.radians(0.2),
)
"""What the odometry of the dynamic body needs: its steps come out a millimetre longer, turn and lead to one
side, left ones otherwise than right ones. Slip, crab and steps are measured on 64 walks of 34 steps; deviations are
wider, for left and right differ. After a stop the soles settle by .4 deg, yet the standing deviation lets the gyro
follow a twist of ten degrees a second: taken for standing still, that would be taken for a bias of the gyro, and
mislead it for minutes."""


WALKED_LANDMARKS = LandmarkConfig(
    head_yaw_sigma_rad=math.radians(0.2),
    head_pitch_sigma_rad=math.radians(0.25),
    head_roll_sigma_rad=math.radians(0.35),
    camera_place_sigma_m=0.002,
)
"""How well the dynamic body knows where its camera is. With the defaults its walks were claimed too cautiously (NIS of
tags .5 of 2); with these, set on two recorded walks, it is .8 and 1.0."""


SCALED = {
    "search": {"wide": ("body_radius_m", "margin_m", "start_radius_m"), "long": ("turn_radius_m",)},
    "univector": {"wide": ("body_radius_m",), "long": ("cruise_mps", "top_speed_mps")},
    "via_field": {"wide": ("body_radius_m",), "long": ("cruise_mps", "top_speed_mps")},
    "guard": {"wide": ("body_radius_m", "cell_distance_m", "cell_contact_m"), "long": ()},
    "guard.gait": {
        "wide": (),
        "long": ("cruise_mps", "max_speed_mps", "max_back_mps", "max_side_mps"),
    },
    "gaze.attention": {"wide": (), "long": ("eye_m",)},
    "swarm.objective": {"wide": ("width_m", "depth_m"), "long": ()},
}
"""What plans by the measures of the body: grows with its width, or with the length of its legs."""


def needs(robot: RobotConfig) -> dict[str, Any]:
    """What this body needs otherwise than the defaults have it, as nested tables.

    Odometry of steps that are really walked, the sway of their cameras, and the measures of another anatomy or
    scale: radii as the circle round the trunk, steps and eye as the legs.
    """
    found: dict[str, Any] = {}
    if robot.body == "dynamic":
        found["localiser"] = _differing(WALKED_LOCALISER, LocaliserConfig())
        found["landmarks"] = _differing(WALKED_LANDMARKS, LandmarkConfig())
    body = robot.dynamic.body
    if body == DARWIN:
        return found
    grown = {
        "wide": math.hypot(*body.trunk_m[:2]) / math.hypot(*DARWIN.trunk_m[:2]),
        "long": body.hip_m / DARWIN.hip_m,
    }
    plain = Config()
    for place, names in SCALED.items():
        table, part = found, plain
        for key in place.split("."):
            table, part = table.setdefault(key, {}), getattr(part, key)
        table |= {name: grown[way] * getattr(part, name) for way in grown for name in names[way]}
    return found


def fitted(config: Config) -> Config:
    """The same with what its body needs, where nothing else was asked for."""
    return config_file.changed(config, _unasked(needs(config.robot), config, Config()))


def _unasked(wanted: dict[str, Any], config: Any, plain: Any) -> dict[str, Any]:
    """Of nested values those that the configuration still has as the plain one."""
    found: dict[str, Any] = {}
    for name, value in wanted.items():
        have, default = getattr(config, name), getattr(plain, name)
        if isinstance(value, dict):
            found[name] = _unasked(value, have, default)
        elif have == default:
            found[name] = value
    return found


def _differing(one: Any, other: Any) -> dict[str, Any]:
    """Names and values of one dataclass where another of its kind has others."""
    return {name: value for name, value in vars(one).items() if value != getattr(other, name)}


def on_body(config: Config, body: str) -> Config:
    """The same walked by that body, "kinematic" or "dynamic", with what it needs."""
    return fitted(dataclasses.replace(config, robot=dataclasses.replace(config.robot, body=body)))


DECIDING = ("scene", "robot", "mission")
"""Parts of a configuration on which it depends what the others begin with."""


def by_one_camera(config: Config, scene: str) -> Config:
    """The same with what seed 000's walker has: one colour camera, two pictures a step, its worlds' goals by the clock.

    Source: seed 000, sections 2 and 6.5.1.
    """
    from sim.seed_rooms import GOAL_TIMES_S  # worlds are known to who walks in them

    times = GOAL_TIMES_S.get(scene, ())
    return dataclasses.replace(
        config,
        robot=dataclasses.replace(config.robot, tof=False, stereo=False, image_pairs=True),
        swarm=dataclasses.replace(config.swarm, goal_times_s=times),
        mission=dataclasses.replace(config.mission, goals=max(len(times), 1)),
    )


def load(
    path: Path | None,
    overrides: Sequence[str] = (),
    scene: str | None = None,
    seed: int | None = None,
) -> Config:
    """The configuration of a run: defaults for its body and planner, then the file, then single values, scene and seed.

    Args:
        path: TOML file; None for the defaults.
        overrides: Single values as "grid.cell_m=0.02".
        scene: Name of the scene, if it was given.
        seed: Of everything random, if it was given.

    Raises:
        InputError, ConfigError: The file cannot be read, a key is unknown, a value impossible.
    """
    asked = Config() if path is None else config_file.read(Config, path, parts=DECIDING)
    about = [
        one for one in overrides if one.partition(".")[0].partition("=")[0].strip() in DECIDING
    ]
    asked = config_file.override(asked, about)
    begun = Config(robot=asked.robot)
    if asked.mission.planner == "swarm":
        begun = by_one_camera(begun, asked.scene if scene is None else scene)
    config = fitted(begun)
    if path is not None:
        config = config_file.read(Config, path, config)
    config = config_file.override(config, overrides)
    if scene is not None:
        config = dataclasses.replace(config, scene=scene)
    if seed is not None:
        config = dataclasses.replace(config, seed=seed)
    return config
