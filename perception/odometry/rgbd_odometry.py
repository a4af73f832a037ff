"""Where a camera in the hand is, by its own depth images: for recordings that come without poses.

`Odometer` takes the frames of a recording one by one: floor, odometry, places; `way` joins them to the
trajectory of the whole, in an upright world that begins under the camera where the first floor was seen.
`Tracked` is the same as a `Whereabouts`, so that the cycle maps such recordings as it does those with poses.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from ..depth import points, structured_light
from ..floor import choose
from ..floor.choose import FloorConfig
from ..floor.levelling import shadow
from ..floor.prior import handheld_prior
from ..primitives.errors import InputError
from ..primitives.frame import Depth, Frame
from ..primitives.plane import Plane
from ..primitives.pose import Pose3
from ..smoothing.smoother import Solution
from .back_end import BackEnd, BackEndConfig
from .odometry import LOST, Odometry, OdometryConfig, Step
from .pose_uncertainty import Claims
from .pyramid import Pyramid, PyramidConfig, build


@dataclass(frozen=True)
class OdometerConfig:
    """Everything between a depth image and the trajectory."""

    pyramid: PyramidConfig = field(default_factory=PyramidConfig)
    odometry: OdometryConfig = field(default_factory=OdometryConfig)
    back_end: BackEndConfig = field(default_factory=BackEndConfig)
    floor: FloorConfig = field(default_factory=FloorConfig)
    light: structured_light.StructuredLightConfig = field(
        default_factory=structured_light.StructuredLightConfig
    )
    nearest_m: float = 0.3  # as the reach of RGB-D cameras
    farthest_m: float = 6.0  # likewise
    floor_stride: int = 4  # ours: every fourth pixel each way tells the floor as well
    loops: bool = True
    floor_tilt_deg: float = 3.0  # ours: floor against the former ones and the way between
    floor_height_m: float = 0.08  # ours: likewise


class Odometer:
    """Frames in, the camera's way out."""

    def __init__(self, rng: np.random.Generator, config: OdometerConfig | None = None) -> None:
        self.config = config or OdometerConfig()
        self.odometry = Odometry(replace(self.config.odometry, reuse=not self.config.loops))
        self.back_end = BackEnd(rng, self.config.back_end) if self.config.loops else None
        self.states: list[str] = []
        self._rng = rng
        self._T_world_start: Pose3 | None = None

    @property
    def T_world_start(self) -> Pose3 | None:
        """The first image's axes in the upright world; None until a floor is seen."""
        return self._T_world_start

    def take(self, frame: Frame) -> Step:
        """Place the next frame.

        Raises:
            InputError: It has no depth image.
        """
        if frame.depth is None:
            raise InputError(
                f"odometry: the frame at {frame.stamp_s} s has no depth image; give a recording of depth"
            )
        depth = structured_light.depth(frame.depth, self.config.light)
        rgb = None if frame.colour is None else frame.colour.rgb
        if rgb is not None and rgb.shape[:2] != depth.z.shape:
            rgb = None  # not registered to the depth: of no use here
        return self.take_images(depth, rgb)

    def take_images(self, depth: Depth, rgb: np.ndarray | None, sensor: str = "depth") -> Step:
        """Place the next depth image, with its picture if there is one."""
        floor = self._floor(depth, sensor)
        image = build(depth, rgb, floor, self.config.pyramid)
        step = self.odometry.track(image)
        if self.back_end is not None:
            here = self.odometry.references[-1].number == len(self.states)
            self.back_end.take(step, image, here)
        self._upright(image, step)
        self.states.append(step.state)
        return step

    def way(self) -> tuple[list[Pose3], Solution | None]:
        """T_world_camera of every frame so far with loops closed, and the graph's solution."""
        if self.back_end is None:
            raise InputError("odometry: loops were switched off; the steps are the way")
        solution = self.back_end.solve()
        return self.back_end.trajectory(solution), solution

    def claims(self, solution: Solution | None) -> Claims | None:
        """How far each pose of `way` may be off; None without a solution."""
        return None if self.back_end is None else self.back_end.claims(solution)

    def _floor(self, depth: Depth, sensor: str) -> Plane | None:
        c = self.config
        seen = points.from_depth(depth, c.nearest_m, c.farthest_m, c.floor_stride)
        found = choose.find(seen, handheld_prior(None), self._rng, c.floor, sensor)
        return None if found is None else found.plane

    def _upright(self, image: Pyramid, step: Step) -> None:
        """The first floor says what is up."""
        if self._T_world_start is None and image.floor is not None and step.state != LOST:
            self._T_world_start = shadow(image.floor) @ step.T_start_camera.inverse()
