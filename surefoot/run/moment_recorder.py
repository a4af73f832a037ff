"""Records the moments of a run, which the replay page shows: which quantities, how often, at which resolution."""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from mapping.grid.confidence import ConfidenceLayer
from mapping.grid.egocentric_grid import EgocentricGrid
from mapping.ground.levels import Levels
from mapping.objects.footprints import Footprint
from perception.estimate import Estimate
from perception.floor.segmented_view import SegmentedView
from perception.primitives.frame import ColourView, Depth, FeetReading, Frame
from perception.primitives.gaussian import Gaussian
from perception.primitives.obstacle import MOVING, Obstacle
from perception.primitives.pose import Pose2, Pose3
from planning.gaze.selection import DirectionMap
from planning.planners.planner import Decision, Plan
from planning.safety.ahead import Ahead
from planning.safety.prediction import MotionPatterns
from planning.world_model import WorldModel

from ..config.schema import Config
from ..results.moment import UNKNOWN, FloorSeen, Layers, Moment, Prediction, SurfaceSeen
from ..results.moments import MomentWriter
from ..results.run_folder import RunFolder
from .loop import Cycle

# ours: a walk has its frames 0.2 s apart; of a recording at 30 Hz a viewer needs no more
EVERY_S = 0.15
PICTURE_EVERY_S = 0.6  # ours: one per footstep
WIDTH_PX = 320
QUALITY = 50  # ours: of JPEG; WebP would be a third smaller, but takes 35 times as long (5.3 ms)
HEIGHT_STEPS = 256
"""Per metre; a power of two keeps them exact, and 4 mm are below the noise of depth."""
AHEAD_S = (1.0, 2.0, 4.0)  # of predictions
LEAST = 1e-3  # modes of a lower probability are not drawn


class MomentRecorder:
    """Writes the moments of one run; it can be kept in a checkpoint."""

    def __init__(self, folder: RunFolder, config: Config, walks: bool) -> None:
        """Open the file; `walks` says whether the sensors are on a walking robot, which is drawn then."""
        self._writer = MomentWriter(folder, config.robot_model if walks else None)
        self._config = config
        self._patterns = MotionPatterns()
        self._last_s = self._pictured_s = -math.inf
        self._has_camera = False

    def note(self, cycle: Cycle) -> Moment | None:
        """Write the moment of a cycle and return it; None between two moments, unless there was a decision."""
        stamp = cycle.world.stamp_s
        self._patterns.update([one.gone_straight() for one in cycle.world.tracks])
        if cycle.decision is None and stamp - self._last_s < EVERY_S:
            return None
        pictured = self._picture_due(cycle.frame, cycle.world)
        moment = moment_of(cycle, self._config, self._patterns, pictured)
        self._writer.write(moment)
        self._last_s = stamp
        return moment

    def _picture_due(self, frame: Frame, world: WorldModel) -> bool:
        """Whether this moment gets pictures; where a camera picture comes now and then, depth waits for it."""
        camera = frame.colour is not None or frame.stereo is not None
        self._has_camera |= camera
        if not camera and not world.views:
            return False
        wait_s = PICTURE_EVERY_S * (2.0 if self._has_camera and not camera else 1.0)
        if world.stamp_s - self._pictured_s < wait_s:
            return False
        self._pictured_s = world.stamp_s
        return True

    def finish(self, footprints: tuple[Footprint, ...]) -> None:
        """Write the footprints of the static obstacles, and close the file."""
        self._writer.close(footprints)


def moment_of(cycle: Cycle, config: Config, patterns: MotionPatterns, pictured: bool) -> Moment:
    """The moment of a cycle.

    Args:
        cycle: What was measured, estimated and decided.
        config: Ranges of the depth sensors, and settings of the guard for predictions.
        patterns: Motion patterns learnt from the tracks so far.
        pictured: Whether to add the pictures.
    """
    world, estimate, decision = cycle.world, cycle.world.estimate, cycle.decision
    colour = estimate.colour
    if world.levels is None:
        cameras, head = _cameras(estimate)
    else:
        cameras, head = _cameras_above(cycle.frame, world.levels, estimate.pose)
    lenses = {view.sensor: view.depth.camera for view in world.views}
    if world.levels is not None:
        lenses = {name: getattr(cycle.frame, name).camera for name in cameras}
    elif colour is not None:
        lenses["colour"] = colour.camera
    predictions = [_predictions(one, world.stamp_s, patterns) for one in world.tracks]
    return Moment(
        stamp_s=world.stamp_s,
        pose=estimate.pose,
        cameras=cameras,
        lenses={name: lens for name, lens in lenses.items() if name in cameras},
        head=head,
        feet=_feet(cycle.frame.feet, estimate.pose),
        heights_m=None if world.levels is None else _heights(world.levels, cycle.frame.feet),
        height_sigma_m=None if world.levels is None else world.levels.body_m[1],
        floor={
            view.sensor: FloorSeen(
                view.floor.normal,
                float(view.floor.offset_m),
                view.floor.covariance,
                0.0 if view.seen is None else float(view.seen),
            )
            for view in estimate.views
        },
        grid=None if world.grid is None else _layers(world.grid, world.confidence),
        surfaces=_surfaces(world.levels) if world.levels and cycle.frame.footstep_due else None,
        status=tuple(one.words for one in estimate.status),
        tracks=tuple(world.tracks),
        predictions=tuple(predictions),
        timing_ms={name: float(ms) for name, ms in estimate.timing_ms.items()},
        **({} if decision is None else _intention(decision, estimate.pose)),
        **(_pictures(cycle.frame, world, config) if pictured else {}),
    )


def _cameras(estimate: Estimate) -> tuple[dict[str, Pose3], tuple[float, float] | None]:
    """T_map_camera of every sensor with an image, and pan and tilt of the head where the joints tell them."""
    cameras = {view.sensor: view.T_map_camera for view in estimate.views}
    mounts = [view.depth.T_body_camera for view in estimate.views]
    colour = estimate.colour
    if colour is not None:
        mounts.append(colour.T_body_camera)
        first = estimate.views[0] if estimate.views else None
        placed = _of_colour(colour, estimate.pose, first)
        if placed is not None:
            cameras["colour"] = placed
    return cameras, _head(next((one for one in mounts if one is not None), None))


def _cameras_above(
    frame: Frame, levels: Levels, pose: Gaussian | None
) -> tuple[dict[str, Pose3], tuple[float, float] | None]:
    """The same over several levels: by the joints, and of an image in the map by what it saw."""
    seen = {name: getattr(frame, name) for name in ("tof", "depth", "colour")}
    mounts = {name: one.T_body_camera for name, one in seen.items() if one is not None}
    known = {name: mount for name, mount in mounts.items() if mount is not None}
    if pose is None:
        return {}, None
    T_map_body = Pose3((0.0, 0.0, levels.body_m[0])) @ Pose2(*pose.mean.tolist()).lifted()
    cameras = {name: T_map_body @ mount for name, mount in known.items()}
    cameras |= {view.sensor: view.T_map_camera for view in levels.views}
    return cameras, _head(next(iter(known.values()), None))


def _head(mount: Pose3 | None) -> tuple[float, float] | None:
    """Pan and tilt of a camera on the body."""
    if mount is None:
        return None
    axis = mount.rotation[:, 2]
    tilt = -math.asin(min(max(float(axis[2]), -1.0), 1.0))
    return math.atan2(axis[1], axis[0]), tilt


def _of_colour(
    colour: ColourView, pose: Gaussian | None, view: SegmentedView | None
) -> Pose3 | None:
    """T_map_camera of the colour camera: by the depth camera beside it, else by the joints."""
    if view is not None and (view.depth.T_body_camera is None or colour.T_body_camera is None):
        return view.T_map_camera  # pictures of a hand-held camera are aligned
    if view is not None and view.depth.T_body_camera is not None:
        assert colour.T_body_camera is not None
        return view.T_map_camera @ view.depth.T_body_camera.inverse() @ colour.T_body_camera
    if pose is None or colour.T_body_camera is None:
        return None
    return Pose2(*pose.mean.tolist()).lifted() @ colour.T_body_camera


def _feet(feet: FeetReading | None, pose: Gaussian | None) -> Float[np.ndarray, "2 4"] | None:
    """Left and right foot in the world, where the pose of the body is estimated: x, y, yaw, 1 if lifted."""
    if feet is None or pose is None:
        return None
    body = Pose2(*pose.mean.tolist())
    soles = zip((feet.left, feet.right), feet.lifted, strict=True)
    return np.array([[*(body @ foot).vector, float(lifted)] for foot, lifted in soles])


def _heights(levels: Levels, feet: FeetReading | None) -> Float[np.ndarray, "3"] | None:
    """Heights of the body frame and the soles above the ground of the start."""
    if feet is None:
        return None
    body_m, _ = levels.body_m
    return np.array([body_m, body_m + feet.left_m, body_m + feet.right_m])


def _surfaces(levels: Levels) -> tuple[SurfaceSeen, ...]:
    """The surfaces in the world."""
    found = []
    for one in levels.surfaces:
        z, _ = one.height_at(one.outline)
        corners = np.column_stack([levels.stands.apply(one.outline), z + levels.ground_m])
        found.append(SurfaceSeen(corners, one.borders))
    return tuple(found)


def _layers(grid: EgocentricGrid, confidence: ConfidenceLayer | None) -> Layers:
    """The terrain map as bytes, heights in whole steps."""
    probability = np.rint(254.0 * grid.probability).astype(np.uint8)
    probability[~grid.known] = UNKNOWN
    fresh = np.zeros_like(grid.height_m) if confidence is None else confidence.values
    height_m = np.rint(grid.height_m * HEIGHT_STEPS) / np.float32(HEIGHT_STEPS)
    return Layers(
        grid.origin, grid.cell_m, probability, np.rint(255.0 * fresh).astype(np.uint8), height_m
    )


def _predictions(
    obstacle: Obstacle, stamp_s: float, patterns: MotionPatterns
) -> tuple[Prediction, ...]:
    """The modes of an obstacle that may move; none for a static one."""
    if obstacle.moving < MOVING:
        return ()
    ahead = Ahead.of(obstacle, stamp_s, np.array(AHEAD_S), patterns)
    return tuple(
        Prediction(t, float(weight), mean.copy(), P.copy())
        for k, t in enumerate(AHEAD_S)
        for weight, mean, P in zip(
            ahead.weights[k], ahead.means[k], ahead.covariances[k], strict=True
        )
        if weight > LEAST
    )


def _intention(decision: Decision, pose: Gaussian | None) -> dict[str, Any]:
    """Fields of the plan; of a planner that does not tell one, the next step alone."""
    plan, walk = decision.plan or Plan(), decision.walk
    steps = plan.steps
    if not len(steps) and pose is not None:
        step = Pose2(walk.forward_m, walk.lateral_m, walk.turn_rad)
        steps = (Pose2(*pose.mean.tolist()) @ step).vector[None]
    finite = plan.risk is not None and math.isfinite(plan.risk)
    return {
        "steps": steps,
        "route": plan.route,
        "goal": plan.goal,
        "gaze": (decision.gaze.pan_rad, decision.gaze.tilt_rad),
        "gaze_map": None if plan.gaze_map is None else _gaze_map(plan.gaze_map),
        "why": decision.why,
        "risk": plan.risk if finite else None,
    }


def _gaze_map(valued: DirectionMap) -> DirectionMap:
    """The same in whole 255ths of its best value."""
    most = max(float(valued.values.max()), 1e-12)
    values = np.rint(np.maximum(valued.values, 0.0) * (255.0 / most)) / 255.0
    return DirectionMap(values, valued.pans, valued.tilts)


def _pictures(frame: Frame, world: WorldModel, config: Config) -> dict[str, Any]:
    """Fields of the pictures: of the colour camera or the left one of a pair, and the depth of the first view."""
    found: dict[str, Any] = {}
    if frame.colour is not None:
        found["colour"], found["colour_sensor"] = colour_picture(frame.colour.rgb), "colour"
    elif frame.stereo is not None:
        grey = cv2.cvtColor(frame.stereo.left, cv2.COLOR_GRAY2RGB)
        found["colour"], found["colour_sensor"] = colour_picture(np.asarray(grey)), "stereo"
    if world.views:
        view = world.views[0]
        found |= depth_picture(view.depth, view.sensor, config)
    return found


def colour_picture(rgb: UInt8[np.ndarray, "h w 3"]) -> bytes:
    """The field `colour` of a moment."""
    height, width = rgb.shape[:2]
    if width > WIDTH_PX:
        size = (WIDTH_PX, round(height * WIDTH_PX / width))
        rgb = np.asarray(cv2.resize(rgb, size, interpolation=cv2.INTER_AREA))
    picture = cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR)
    done, data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    assert done
    return data.tobytes()


def depth_picture(depth: Depth, sensor: str, config: Config) -> dict[str, Any]:
    """The fields of the depth of a moment.

    Every n-th pixel in whole steps that reach as far as the sensor; 0 where there is none, or farther.
    """
    step_m = 2.0 ** math.ceil(math.log2(config.reach.of(sensor, depth).farthest_m / 255.0))
    every = -(-depth.z.shape[1] // WIDTH_PX)
    shown = depth.z[::every, ::every]
    steps = np.nan_to_num(np.rint(shown / step_m), nan=0.0, posinf=0.0, neginf=0.0)
    levels = np.where((steps < 0.0) | (steps > 255.0), 0.0, steps).astype(np.uint8)
    return {"depth": levels, "depth_step_m": step_m, "depth_sensor": sensor}
