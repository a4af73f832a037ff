"""The views of a panorama: which frames of a recording become views, with which prior poses above the floor.

With poses, of the recording or of the pipeline, frames become views as the camera turns or moves, and the floor of all
views is the floor of their base frame. By pictures alone, views are taken evenly over the recording.

Source: ours.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from mapping.panorama.views import PriorConfig, View, view_of_depth
from perception.depth import points
from perception.depth.sources import DepthSources
from perception.depth.undistortion import undistorted
from perception.floor.common_floor import CommonFloor, FloorView, find_common, floor_view
from perception.floor.levelling import UP, rotation_between
from perception.floor.prior import HAND_HEIGHT_M, HAND_UP
from perception.localisation.given_poses import HEADING_DEG
from perception.primitives.frame import Depth, Frame
from perception.primitives.pose import Pose2, Pose3

from ..config.schema import Config
from ..progress import Say
from ..recordings.recording import Recording
from ..run.pipeline import Pipeline

FARTHEST_M = 5.0  # ours: range that is white in the pictures in which features are found
SEED = 43  # of the floor search


class Seen(NamedTuple):
    """A frame that may become a view.

    Args:
        number: Of the frame.
        stamp_s: Of the frame.
        sensor: Of the depth image.
        depth: Without lens distortion.
        grey: Colour as grey, or amplitude, of the same pixels; None without either.
        T_world_camera: Pose in the axes of the pose source; None if pictures alone place the views.
        sigmas: Standard deviations of heading (deg) and position (m) of the pose.
    """

    number: int
    stamp_s: float
    sensor: str
    depth: Depth
    grey: UInt8[np.ndarray, "h w"] | None
    T_world_camera: Pose3 | None
    sigmas: tuple[float, float] = (0.0, 0.0)


@dataclass(eq=False)
class Gathered:
    """The views of one place.

    Args:
        views: With prior poses in the base frame, or without if only the pictures place them. The origin of the base is
            on the floor below the first camera; x is the mean viewing direction.
        shown: What each view shows of the floor, with its pose if there is one.
        frames: Frame number of each view.
        prior: Standard deviations of the prior poses, from the pose covariance.
        left_out: Frames that were too far from the first view, or too many.
        floor: The floor of all views, base frame; None if no view shows it.
        used: Frames with a usable depth image.
        sensor: Of the depth images.
    """

    views: list[View] = field(default_factory=list)
    shown: list[FloorView] = field(default_factory=list)
    frames: list[int] = field(default_factory=list)
    prior: PriorConfig = field(default_factory=PriorConfig)
    left_out: int = 0
    floor: CommonFloor | None = None
    used: int = 0
    sensor: str = "depth"

    def add(self, seen: Seen, config: Config) -> None:
        """Add a view."""
        reach = config.reach.of(seen.sensor, seen.depth)
        cloud = points.from_depth(seen.depth, reach.nearest_m, reach.farthest_m, reach.stride)
        self.shown.append(floor_view(cloud, seen.T_world_camera or Pose3(), seen.sensor))
        pose = seen.T_world_camera
        self.views.append(view_of_depth(seen.depth, FARTHEST_M, seen.grey, pose, seen.stamp_s))
        self.frames.append(seen.number)
        self.sensor = seen.sensor
        heading_deg, position_m = seen.sigmas
        self.prior = replace(
            self.prior,
            pan_deg=max(self.prior.pan_deg, heading_deg),
            position_m=max(self.prior.position_m, position_m),
        )


def gather(recording: Recording, config: Config, say: Say) -> Gathered:
    """Select the views of a recording.

    Args:
        recording: A recording with depth of any kind.
        config: Settings; [panorama] selects the views.
        say: Progress.
    """
    if config.panorama.by_pictures:
        return _gather_evenly(recording, config, say)
    found, wanted = Gathered(), config.panorama
    kept: list[Pose3] = []
    for seen in _seen(recording, config):
        pose = seen.T_world_camera
        found.used += 1
        if pose is None or not wanted.is_new(pose, kept):
            continue
        if len(kept) >= wanted.most_views or not wanted.is_near(pose, kept):
            found.left_out += 1
            continue
        kept.append(pose)
        found.add(seen, config)
        say(f"frame {seen.number}: view {len(kept)}")
    if kept:
        info = recording.info
        if info.poses_given:
            up = None if info.gravity_up_world is None else np.asarray(info.gravity_up_world)
            T_base_world = found_base(found, kept, up, config)
        else:  # the map of the pipeline is upright
            T_base_world = found_base(found, kept, UP, config, expected=Pose3())
        found.views = [
            replace(view, prior=T_base_world @ pose)
            for view, pose in zip(found.views, kept, strict=True)
        ]
    return found


def _gather_evenly(recording: Recording, config: Config, say: Say) -> Gathered:
    """Views evenly over the recording, as many as are wanted."""
    found, most = Gathered(), config.panorama.most_views
    count = recording.info.frames or sum(1 for _ in recording.frames())
    apart = max(1.0, count / most)
    for seen in _images(recording, config):
        found.used += 1
        if seen.number < apart * len(found.views):
            found.left_out += 1
            continue
        found.add(seen._replace(T_world_camera=None), config)
        say(f"frame {seen.number}: view {len(found.views)}")
    return found


def _seen(recording: Recording, config: Config) -> Iterator[Seen]:
    """The depth images with the poses of the recording, or of the pipeline if there are none."""
    if recording.info.poses_given:
        yield from (one for one in _images(recording, config) if one.T_world_camera is not None)
        return
    pipeline = Pipeline(config, recording.info)
    for number, frame in enumerate(recording.frames()):
        estimate = pipeline.cycle(frame).estimate
        if not estimate.views:
            continue
        view = estimate.views[0]
        sigmas = (0.0, 0.0)
        if estimate.pose is not None:
            x, y, yaw = np.sqrt(np.diag(estimate.pose.covariance)).tolist()
            sigmas = (math.degrees(yaw), max(x, y))
        images = _undistorted(frame, view.depth)
        yield Seen(number, frame.stamp_s, view.sensor, *images, view.T_map_camera, sigmas)


def _images(recording: Recording, config: Config) -> Iterator[Seen]:
    """The first depth image of each frame, with the pose that came with it."""
    sources = DepthSources(
        config.tof,
        config.structured_light,
        config.stereo,
        config.depth_sources,
        recording.info.own_body,
    )
    sigmas = (HEADING_DEG, config.prior.given_position_m)
    for number, frame in enumerate(recording.frames()):
        for sensor, image in sources.images(frame):
            if np.isfinite(image.z).any():
                images = _undistorted(frame, image)
                yield Seen(number, frame.stamp_s, sensor, *images, frame.T_world_camera, sigmas)
            break


def found_base(
    found: Gathered,
    poses: list[Pose3],
    up: Float[np.ndarray, "3"] | None,
    config: Config,
    expected: Pose3 | None = None,
) -> Pose3:
    """T_base_world by the floor of all views.

    Args:
        found: The views; their floor is entered.
        poses: T_world_camera of each.
        up: Approximate vertical of the world; None if unknown.
        config: Settings of the floor search.
        expected: T_level_world without a floor in view; None: by the vertical and the usual height of a camera.
    """
    floor = find_common(found.shown, up, np.random.default_rng(SEED), config.floor)
    if floor is not None:
        T_base_world = base_of(floor.T_level_world, poses)
        found.floor = replace(floor, plane=floor.plane.moved(T_base_world))
        return T_base_world
    if expected is not None:
        return base_of(expected, poses)
    if up is None:
        up = np.mean([pose.rotation @ HAND_UP for pose in poses], axis=0)
        up /= np.linalg.norm(up)
    height = float(np.mean([pose.position @ up for pose in poses]))
    level = Pose3.from_rotation(
        rotation_between(up, UP), np.array([0.0, 0.0, HAND_HEIGHT_M - height])
    )
    return base_of(level, poses)


def base_of(T_level_world: Pose3, poses: list[Pose3]) -> Pose3:
    """T_base_world: on the floor below the first camera, x in the mean viewing direction.

    Args:
        T_level_world: z up, and zero on the floor.
        poses: T_world_camera.
    """
    level = [T_level_world @ pose for pose in poses]
    ahead = np.mean([pose.rotation[:, 2] for pose in level], axis=0)
    x, y, _ = level[0].translation
    return Pose2(x, y, math.atan2(ahead[1], ahead[0])).lifted().inverse() @ T_level_world


def _undistorted(frame: Frame, image: Depth) -> tuple[Depth, UInt8[np.ndarray, "h w"] | None]:
    """A depth image and its picture without lens distortion."""
    picture = _picture(frame, image)
    layers = None if picture is None else np.repeat(picture[..., None], 3, axis=2)
    depth, flat = undistorted(image, layers)
    return depth, None if flat is None else np.ascontiguousarray(flat[..., 0])


def _picture(frame: Frame, depth: Depth) -> UInt8[np.ndarray, "h w"] | None:
    """Grey picture of the pixels of a depth image, from colour or amplitude; None without either."""
    shape = depth.z.shape
    if frame.colour is not None and frame.colour.rgb.shape[:2] == shape:
        return np.asarray(cv2.cvtColor(frame.colour.rgb, cv2.COLOR_RGB2GRAY), np.uint8)
    amplitude = None if frame.tof is None else frame.tof.amplitude
    if amplitude is None or amplitude.shape != shape:
        return None
    bright = float(np.nanpercentile(amplitude, 99.0))
    level = np.nan_to_num(amplitude / max(bright, 1e-6))
    return (255.0 * np.sqrt(np.clip(level, 0.0, 1.0))).astype(np.uint8)
