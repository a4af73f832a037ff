"""The settings of the simulated robot, and what a body or a description makes of them.

Source: seeds 003 and 004 (cameras); the rest ours.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

from perception.primitives.errors import ConfigError
from perception.primitives.settings import setting

from . import bullet
from .body.described import gait_of, head_of, measures_of
from .body.dynamic import engines
from .body.dynamic.anatomy import DARWIN, Anatomy, gait_for, head_for
from .body.dynamic.config import DynamicConfig
from .body.gait import GaitConfig
from .body.head import HeadConfig
from .body.inertial import ImuConfig
from .body.kinematic import SlipConfig, SwayConfig
from .free_space import ROBOT_TOP_M
from .ranges import check_ranges
from .robots import catalogue
from .robots.description import SENSORS, Description, Sensor
from .scenes.walker import SMALL, Walker
from .sensors.cameras import ImageConfig
from .sensors.depth_camera import DepthCameraConfig
from .sensors.tof_camera import TofConfig
from .world import RANGE_SOURCES

BODIES = ("kinematic", "dynamic")


@dataclass(frozen=True)
class RobotConfig:
    """Sensors of the robot, and the errors of sensors and body.

    A camera that is switched off is not rendered; its part of the frame is None. `slip` and `sway` belong to the
    kinematic body, `dynamic` to the dynamic one, but its anatomy and scale apply to both. Mounts, baseline, gait and
    head are those of a DARwIn-OP and scale with the body.
    """

    model: str = setting(
        catalogue.OWN,
        "",
        "surefoot, g1, talos, icub, or a .toml file that describes a robot",
        "ours",
    )
    body: str = setting(
        "kinematic",
        "",
        "kinematic (exact footsteps, drawn slip) or dynamic (physics engine)",
        "ours",
    )
    tof: bool = setting(True, "", "enables the time-of-flight camera", "seed 004")
    tof_fails_at_s: float = setting(
        0.0,
        "s",
        "time from which the time-of-flight camera fails; 0 is never",
        "ours: fault injection",
    )
    tof_source: str = setting(
        "camera",
        "",
        "what the time-of-flight camera measures by: camera (PyBullet's) or rays (ray casting)",
        "ours",
    )
    stereo: bool = setting(True, "", "enables the stereo camera", "seed 003")
    colour: bool = setting(True, "", "enables the colour camera", "seed 000")
    image_pairs: bool = setting(
        False, "", "colour and stereo images twice per step instead of once", "seed 000: twice"
    )
    depth: bool = (
        False  # active stereo at the place of the time-of-flight camera, of a described robot
    )
    tof_mount_m: tuple[float, float, float] = (
        0.035,
        0.0,
        0.035,
    )  # DARwIn-OP; position of the time-of-flight camera in the head
    baseline_m: float = 0.04  # seed 003; baseline of the stereo camera
    gait: GaitConfig = field(default_factory=GaitConfig)
    slip: SlipConfig = field(default_factory=SlipConfig)
    sway: SwayConfig = field(default_factory=SwayConfig)
    dynamic: DynamicConfig = field(default_factory=DynamicConfig)
    head: HeadConfig = field(default_factory=HeadConfig)
    imu: ImuConfig = field(default_factory=ImuConfig)
    tof_camera: TofConfig = field(default_factory=TofConfig)
    depth_camera: DepthCameraConfig = field(default_factory=DepthCameraConfig)
    colour_camera: ImageConfig = field(default_factory=ImageConfig)
    stereo_camera: ImageConfig = field(
        default_factory=lambda: ImageConfig(640, 480, 60.0, (0.035, 0.02, 0.035))
    )  # ours, the left camera: f = 554 px

    @property
    def described(self) -> Description | None:
        """The description of a robot with a URDF; None for our own.

        Raises:
            ConfigError, InputError: It is unknown, or its file is wrong.
        """
        return None if self.model == catalogue.OWN else catalogue.load(self.model)

    @property
    def measures(self) -> Anatomy:
        """Sizes of trunk and feet, for contact."""
        found = self.described
        return self.dynamic.body if found is None else measures_of(found)

    @property
    def walker(self) -> Walker:
        """The robot as scenes know it; for our own they are made as they are."""
        found = self.described
        if found is None:
            return SMALL
        model = found.model
        return Walker(max(1.0, model.breadth), max(ROBOT_TOP_M, model.height_m))

    @property
    def needs_pybullet(self) -> bool:
        """Whether PyBullet renders images or ranges, or moves the body."""
        rendered = (self.tof or self.depth) and self.tof_source == "camera"
        moved = self.body == "dynamic" and self.dynamic.engine == "pybullet"
        return moved or self.colour or self.stereo or rendered

    def require(self) -> None:
        """Check, without loading them, that the packages are installed that render its images and move its body.

        Raises:
            SurefootError: One is not.
        """
        if self.needs_pybullet:
            bullet.require()
        if self.body == "dynamic":
            engines.require(self.dynamic.engine)

    def __post_init__(self) -> None:
        if self.body not in BODIES:
            raise ConfigError(f"robot: body={self.body!r} is unknown; choose {', '.join(BODIES)}")
        if self.body == "dynamic":
            self._check_dynamic()
        if self.tof_source not in RANGE_SOURCES:
            raise ConfigError(
                f"robot: tof_source={self.tof_source!r} is unknown; choose {', '.join(RANGE_SOURCES)}"
            )
        if not self.tof_fails_at_s >= 0.0:
            raise ConfigError(
                f"robot: tof_fails_at_s={self.tof_fails_at_s} must not be negative; 0 is never"
            )
        if not self.baseline_m > 0.0:
            raise ConfigError(f"robot: baseline_m={self.baseline_m} must be positive")
        check_ranges("robot", self, tof_mount_m=(-2.0, 2.0), baseline_m=(0.0, 1.0))

    def _check_dynamic(self) -> None:
        """Raise a ConfigError unless a described robot has a dynamic body in this engine."""
        found = self.described
        if found is None:
            return
        if found.dynamic is None:
            raise ConfigError(
                f"robot: model={self.model!r} has no dynamic body: no table [dynamic] in {found.file}; set body='kinematic'"
            )
        if self.dynamic.engine != "pybullet":
            raise ConfigError(
                f"robot: dynamic.engine={self.dynamic.engine!r} is for our own robot; "
                f"model={self.model!r} walks in 'pybullet'"
            )


def grown(config: RobotConfig) -> RobotConfig:
    """The same with gait, head and cameras where this body has them."""
    found = config.described
    if found is not None:
        return _described(config, found)
    body = config.dynamic.body
    factor = body.hip_m / DARWIN.hip_m
    if factor == 1.0:
        return config

    def times(mount_m: tuple[float, float, float]) -> tuple[float, float, float]:
        x, y, z = mount_m
        return factor * x, factor * y, factor * z

    colour, stereo = config.colour_camera, config.stereo_camera
    return replace(
        config,
        gait=gait_for(body, config.gait),
        head=head_for(body, config.head),
        tof_mount_m=times(config.tof_mount_m),
        colour_camera=replace(colour, mount_m=times(colour.mount_m)),
        stereo_camera=replace(stereo, mount_m=times(stereo.mount_m)),
        baseline_m=factor * config.baseline_m,
    )


def _described(config: RobotConfig, robot: Description) -> RobotConfig:
    """Gait, gaze and cameras of a description; noise and timing of the cameras stay as configured."""
    config = replace(config, gait=gait_of(robot, config.gait), head=head_of(robot, config.head))
    tof, depth, stereo, colour = (robot.sensor(name) for name in SENSORS)
    if tof is not None:
        pixels = replace(config.tof_camera, **_view(tof), down_deg=tof.down_deg)
        config = replace(config, tof_camera=pixels, tof_mount_m=tof.at_m)
    if depth is not None:
        active = replace(
            config.depth_camera,
            **_view(depth),
            down_deg=depth.down_deg,
            baseline_m=depth.baseline_m,
        )
        config = replace(config, depth_camera=active, tof_mount_m=depth.at_m)
    if stereo is not None:
        pair = _pixels(config.stereo_camera, stereo)
        config = replace(config, stereo_camera=pair, baseline_m=stereo.baseline_m)
    if colour is not None:
        config = replace(config, colour_camera=_pixels(config.colour_camera, colour))
    return replace(
        config,
        tof=config.tof and tof is not None,
        depth=depth is not None,
        stereo=config.stereo and stereo is not None,
        colour=config.colour and colour is not None,
    )


def _pixels(camera: ImageConfig, sensor: Sensor) -> ImageConfig:
    return replace(camera, **_view(sensor), mount_m=sensor.at_m)


def _view(sensor: Sensor) -> dict[str, Any]:
    return {"width": sensor.width, "height": sensor.height, "across_deg": sensor.across_deg}
