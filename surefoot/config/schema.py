"""The configuration of a run: the parts of every package, joined.

It works without a file. A file may leave out any part. A run writes the complete configuration beside its results,
and that file repeats the run to the same numbers.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field

from mapping.grid.confidence import ConfidenceConfig
from mapping.grid.egocentric_grid import GridConfig
from mapping.grid.world_map import WorldMapConfig
from mapping.ground.config import GroundConfig
from mapping.io.clouds import CloudConfig
from mapping.objects.footprints import FootprintConfig
from mapping.panorama.view_selection import ViewSelectionConfig
from mapping.surface.tsdf_config import TsdfConfig
from perception.depth.distortion import Distortion, DistortionConfig
from perception.depth.health import DepthHealthConfig
from perception.depth.reach import ReachesConfig
from perception.depth.sources import SENSORS
from perception.depth.stereo import StereoConfig
from perception.depth.structured_light import StructuredLightConfig
from perception.depth.time_of_flight import TofConfig
from perception.floor.choose import FloorConfig
from perception.floor.classify import ClassConfig
from perception.localisation.landmarks import LandmarkConfig
from perception.localisation.localiser_noise import LocaliserConfig
from perception.localisation.pose_source import PriorConfig
from perception.localisation.registration import RegistrationConfig
from perception.monocular.cycle import MonocularConfig
from perception.obstacles.clustering import ClusterConfig
from perception.obstacles.colour_detection import ColouredConfig
from perception.obstacles.tracker import TrackerConfig
from perception.odometry.rgbd_odometry import OdometerConfig
from perception.primitives import plugins
from perception.primitives.errors import ConfigError
from perception.primitives.robot_model import GaitLimits, RobotModel
from perception.primitives.settings import setting
from planning.avoidance.choice import AvoidanceConfig
from planning.exploration import ExplorationConfig
from planning.footholds.search import FootholdConfig
from planning.gaze.policy import GazeConfig
from planning.planners.mission import MissionConfig
from planning.planners.settings import BESIDE_GUARD, PlanningConfig
from planning.safety.guard import GuardConfig
from planning.search.potential import SearchConfig
from planning.search.route import RouteConfig
from planning.swarm.settings import SwarmWalkerConfig
from planning.univector.fields import FieldConfig
from sim.faults.injection import FaultConfig
from sim.movers.law import MoversConfig
from sim.robot_config import RobotConfig
from sim.scenes.difficulty import USUAL
from sim.scenes.difficulty import check as check_difficulty

from .robot_model import model_of

CALIBRATED_TOF = TofConfig(wiggle_m=0.004, stray_share=0.02)
"""Ours: noise of the simulated robot's ToF camera by calibration; another camera needs its own values."""


CALIBRATED_DISTORTION = DistortionConfig(
    tof=Distortion(share=0.0001),
    stereo=Distortion(noises=0.05),
    depth=Distortion(share=0.0005, share_per_m=0.0005),
)
"""Ours: what calibration leaves of the distortion of the simulated robot's cameras: for ToF and stereo by the NEES of 24
views (seeds 5000 to 5023); for an RGB-D camera a tenth of the published size."""


@dataclass(frozen=True)
class Config:
    """Everything a run depends on."""

    scene: str = setting("home", "", "name of a scene, or a scene file", "ours")
    seed: int = setting(0, "", "seed of scene, noise and random choices", "ours")
    difficulty: float = setting(
        USUAL, "", "of the scene, 0 easy to 1 hard: number, speed and distance of obstacles", "ours"
    )
    ignore_poses: bool = setting(
        False,
        "",
        "estimate the trajectory without the poses of the recording, which serve as its truth",
        "ours",
    )
    depth_sources: tuple[str, ...] = setting(
        SENSORS, "", "sources of depth: tof, depth, stereo, or package.module:Class", "ours"
    )
    reader: str = setting(
        "",
        "",
        "recording reader, package.module:Class; empty: by the format of the recording",
        "ours",
    )
    renderer: str = setting(
        "auto", "", "egl, tiny (software), or auto (egl where it works)", "ours"
    )
    mission: MissionConfig = field(default_factory=MissionConfig)
    robot: RobotConfig = field(default_factory=RobotConfig)
    movers: MoversConfig = field(default_factory=MoversConfig)
    faults: FaultConfig = field(default_factory=FaultConfig)
    reach: ReachesConfig = field(default_factory=ReachesConfig)
    tof: TofConfig = field(default_factory=lambda: CALIBRATED_TOF)
    stereo: StereoConfig = field(default_factory=StereoConfig)
    structured_light: StructuredLightConfig = field(default_factory=StructuredLightConfig)
    floor: FloorConfig = field(default_factory=FloorConfig)
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
    ground: GroundConfig = field(default_factory=GroundConfig)
    world_map: WorldMapConfig = field(default_factory=WorldMapConfig)
    odometer: OdometerConfig = field(default_factory=OdometerConfig)
    cloud: CloudConfig = field(default_factory=CloudConfig)
    footprints: FootprintConfig = field(default_factory=FootprintConfig)
    surface: TsdfConfig = field(default_factory=TsdfConfig)
    panorama: ViewSelectionConfig = field(default_factory=ViewSelectionConfig)
    search: SearchConfig = field(default_factory=SearchConfig)
    route: RouteConfig = field(default_factory=RouteConfig)
    gait: GaitLimits = field(default_factory=GaitLimits)
    footholds: FootholdConfig = field(default_factory=FootholdConfig)
    exploration: ExplorationConfig = field(default_factory=ExplorationConfig)
    univector: FieldConfig = BESIDE_GUARD
    guard: GuardConfig = field(default_factory=GuardConfig)
    monocular: MonocularConfig = field(default_factory=MonocularConfig)
    swarm: SwarmWalkerConfig = field(default_factory=SwarmWalkerConfig)
    avoidance: AvoidanceConfig = field(default_factory=AvoidanceConfig)
    gaze: GazeConfig = field(default_factory=GazeConfig)
    depth_health: DepthHealthConfig = field(default_factory=DepthHealthConfig)

    @property
    def planning(self) -> PlanningConfig:
        """The part that planners see."""
        names = {item.name for item in dataclasses.fields(PlanningConfig)} - {"robot", "cell_m"}
        parts = {name: getattr(self, name) for name in names}
        return PlanningConfig(robot=self.robot_model, cell_m=self.grid.cell_m, **parts)

    @property
    def robot_model(self) -> RobotModel:
        """Sizes and limits of the configured body, for planning."""
        return model_of(self.robot, self.gait)

    def floor_of(self, calibrated: bool) -> FloorConfig:
        """The floor search in a recording: calibrated cameras hardly distort, unless the user says otherwise."""
        if not calibrated or self.floor.distortion != DistortionConfig():
            return self.floor
        return dataclasses.replace(self.floor, distortion=CALIBRATED_DISTORTION)

    def resolved(self, renderer: str) -> Config:
        """The same with the renderer that is used."""
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
        if self.univector.mode != "ours" and self.mission.planner == "search":
            raise ConfigError(
                f"univector: mode={self.univector.mode!r} walks without search and guard; set mission.planner='field'"
            )
        check_difficulty(self.difficulty)
        for name in self.depth_sources:
            problem = plugins.check(name, dict.fromkeys(SENSORS, ""), "depth source")
            if problem is not None:
                raise ConfigError(f"depth_sources: {problem}")
        if self.reader and not plugins.is_reference(self.reader):
            raise ConfigError(f"reader={self.reader!r} must be package.module:Class")
        if self.renderer not in ("auto", "egl", "tiny"):
            raise ConfigError(f"renderer={self.renderer!r} is unknown; choose auto, egl or tiny")
