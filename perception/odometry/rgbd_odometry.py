"""The trajectory of a hand-held RGB-D camera: floor detection, odometry, loop closures, pose graph.

`Odometer` takes the frames of a recording one by one; `trajectory` then returns the poses of the whole
recording with loops closed. The world frame is upright, with z = 0 on the floor, below the camera of the
first image in which a floor is found.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from ..depth import points, structured_light
from ..depth.reach import ReachesConfig
from ..depth.structured_light import StructuredLightConfig
from ..floor import choose
from ..floor.choose import FloorConfig
from ..floor.prior import handheld_prior
from ..primitives.errors import InputError
from ..primitives.frame import Depth, Frame
from ..primitives.plane import Plane
from ..primitives.pose import Pose3
from ..primitives.settings import setting
from ..smoothing.smoother import Solution
from .alarm import Alarm, AlarmConfig
from .alignment import AlignConfig
from .back_end import BackEnd, BackEndConfig, world_by_floor
from .depth_bend import BendOfPairs
from .odometry import Odometry, OdometryConfig, Step
from .pose_uncertainty import PoseUncertainty
from .pyramid import PyramidConfig, build
from .vergence import VergenceOfPairs
from .view_errors import ViewErrorSize

FLOOR_REACH_M = (0.3, 6.0)  # the range of RGB-D cameras; that of a long stereo pair is farther
BEND_LEVEL = 1  # ours: half the finest size tells as much, in a quarter of the time
FLOOR_STRIDE = 4  # ours: every fourth pixel along each axis determines the floor as well


@dataclass(frozen=True)
class OdometerConfig:
    """Settings of RGB-D odometry."""

    pyramid: PyramidConfig = field(default_factory=PyramidConfig)
    align: AlignConfig = field(default_factory=AlignConfig)
    odometry: OdometryConfig = field(default_factory=OdometryConfig)
    back_end: BackEndConfig = field(default_factory=BackEndConfig)
    alarm: AlarmConfig = field(default_factory=AlarmConfig)
    loops: bool = setting(
        True,
        "",
        "recognises known places and closes loops once the recording ends",
        "ours: Kümmerle et al. 2011; live poses do without",
    )


class Odometer:
    """Estimates the camera's trajectory from the depth images of a recording.

    Attributes:
        states: State of every frame so far, see `odometry.Step`.
        failures: Probability that the pose of the frame is wrong, see `alarm`.
        view_error: Size of the error that depends on the view, see `view_errors`.
        bend: Estimates the bend of an RGB-D camera from its motion.
        vergence: The same of the vergence of a stereo pair.
    """

    def __init__(
        self,
        rng: np.random.Generator,
        config: OdometerConfig | None = None,
        floor: FloorConfig | None = None,
        noise: StructuredLightConfig | None = None,
        reach: ReachesConfig | None = None,
    ) -> None:
        """Begin before the first frame.

        Args:
            rng: Samples points of the floor and matches of features.
            config: Settings of the odometry; the defaults if None.
            floor: Settings of the floor detector.
            noise: Noise model of the depth camera.
            reach: Depths in which the floor is looked for, if they differ from the default ones; else `FLOOR_REACH_M`.
        """
        self.config = config or OdometerConfig()
        loops = self.config.loops
        self.odometry = Odometry(replace(self.config.odometry, reuse=not loops), self.config.align)
        self.back_end = BackEnd(rng, self.config.back_end, self.config.align) if loops else None
        self.states: list[str] = []
        self.failures: list[float] = []
        self.view_error = ViewErrorSize()
        self.bend = BendOfPairs(BEND_LEVEL)
        self._alarm = Alarm()
        self._rng = rng
        self._floor_config, self._noise = floor or FloorConfig(), noise
        self._reach = reach or ReachesConfig()
        self.vergence = VergenceOfPairs(self._floor_config.distortion.stereo)
        self._T_world_start: Pose3 | None = None

    @property
    def T_world_start(self) -> Pose3 | None:
        """Pose of the first image in the upright world frame; None until a floor is found."""
        return self._T_world_start

    def track(self, frame: Frame) -> Step:
        """Estimate the pose of the next frame.

        Raises:
            InputError: The frame has no depth image.
        """
        if frame.depth is None:
            raise InputError(
                f"odometry: the frame at {frame.stamp_s} s has no depth image; give a recording of depth"
            )
        depth = structured_light.depth(frame.depth, self._noise)
        rgb = None if frame.colour is None else frame.colour.rgb
        if rgb is not None and rgb.shape[:2] != depth.z.shape:
            rgb = None  # not registered to the depth image
        return self.track_images(depth, rgb)

    def track_images(self, depth: Depth, rgb: np.ndarray | None, sensor: str = "depth") -> Step:
        """Estimate the pose of the next depth image, with its registered colour image if there is one."""
        distortion = self._floor_config.distortion.of(sensor)
        image = build(depth, rgb, self._floor(depth, sensor), self.config.pyramid, distortion)
        self.view_error.add(image)
        step = self.odometry.track(image)
        is_reference = self.odometry.references[-1].number == len(self.states)
        if is_reference and sensor == "depth":
            self.bend.note(step, len(self.states), image)
        baseline_m = depth.baseline_m if sensor == "stereo" else 0.0
        self.vergence.note(step, image, baseline_m, is_reference)
        if self.back_end is not None:
            self.back_end.take(step, image, is_reference)
        self._T_world_start = self._T_world_start or world_by_floor(step, image)
        self.states.append(step.state)
        self.failures.append(self._alarm.note(step, image))
        return step

    def trajectory(self) -> tuple[list[Pose3], Solution | None]:
        """T_world_camera of every frame so far with loops closed, and the solution of the pose graph."""
        if self.back_end is None:
            raise InputError("odometry: loops=false has no pose graph; use the poses of the steps")
        solution = self.back_end.solve()
        return self.back_end.trajectory(solution), solution

    def uncertainty(self, solution: Solution | None) -> PoseUncertainty | None:
        """Covariance of every pose of `trajectory`; None without two poses."""
        if self.back_end is None:
            return None
        found = self.back_end.uncertainty(solution, self.view_error.covariance)
        if found is None:
            return None
        common = self.vergence.covariances(
            self.back_end.trajectory(solution), self.back_end.T_world_start
        )
        return PoseUncertainty(found.from_start + common.from_start, found.aligned + common.aligned)

    def _floor(self, depth: Depth, sensor: str) -> Plane | None:
        reach, usual = self._reach.of(sensor, depth), ReachesConfig().of(sensor, depth)
        nearest_m, farthest_m = reach.nearest_m, reach.farthest_m
        if reach == usual:
            nearest_m, farthest_m = FLOOR_REACH_M[0], max(FLOOR_REACH_M[1], farthest_m)
        seen = points.from_depth(depth, nearest_m, farthest_m, FLOOR_STRIDE)
        found = choose.find(seen, handheld_prior(None), self._rng, self._floor_config, sensor)
        return None if found is None else found.plane
