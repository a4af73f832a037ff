"""The panoramic map of a recording: depth views from about one place, stitched, and the obstacles and gaps in it.

The camera pose of each frame comes with the recording, or from the pipeline; `view_selection` chooses the frames that
become views. Without poses, or if they are not to be used, the pictures alone determine how the views lie to each
other. In either case the floor that all views show together is the floor of the panorama, whatever the axes of the
poses.

Files: `panorama.ply` (cloud), `panorama.npz` (range and its standard deviation on the sphere), `panorama.json`
(views, floor, obstacles and gaps with their standard deviations), `panorama_obstacles.png`.

Source: seed 004, sections 2.2 and 2.3 of its paper; views of a walking camera and the floor are ours.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, replace
from typing import Any, NamedTuple

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from mapping.io import clouds
from mapping.panorama.adjustment import Prior, adjust, anchor
from mapping.panorama.obstacles import PanoramaGap, PanoramaObstacle, Surroundings
from mapping.panorama.rendering import render
from mapping.panorama.sizes import surroundings
from mapping.panorama.stitching import Panorama, Placement, StitchConfig, place
from mapping.panorama.views import PriorConfig, View, view_of_depth
from perception.depth import points
from perception.depth.sources import DepthSources
from perception.depth.undistortion import undistorted
from perception.floor.common_floor import CommonFloor, FloorView, find_common, floor_view
from perception.floor.levelling import UP, rotation_between
from perception.floor.prior import HAND_HEIGHT_M, HAND_UP
from perception.localisation.given_poses import HEADING_DEG
from perception.primitives.errors import RecordingError
from perception.primitives.frame import Depth, Frame
from perception.primitives.pose import Pose2, Pose3

from ..config.schema import Config
from ..recordings.recording import Recording
from ..report.plots import panorama as plots_panorama
from ..report.plots import style
from ..run.pipeline import Pipeline
from .job import Job, Say, count_reasons

FARTHEST_M = 5.0  # ours: range that is white in the pictures in which features are found
SEED = 43  # of the RANSAC that matches pictures
LEAST_PLACED = 0.5  # ours: with fewer of the views in place, most of the surroundings are missing


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
    """

    views: list[View] = field(default_factory=list)
    shown: list[FloorView] = field(default_factory=list)
    frames: list[int] = field(default_factory=list)
    prior: PriorConfig = field(default_factory=PriorConfig)
    left_out: int = 0
    floor: CommonFloor | None = None
    used: int = 0

    def add(self, seen: Seen, config: Config) -> None:
        """Add a view."""
        reach = config.reach.of(seen.sensor)
        cloud = points.from_depth(seen.depth, reach.nearest_m, reach.farthest_m, reach.stride)
        self.shown.append(floor_view(cloud, seen.T_world_camera or Pose3(), seen.sensor))
        pose = seen.T_world_camera
        self.views.append(view_of_depth(seen.depth, FARTHEST_M, seen.grey, pose, seen.stamp_s))
        self.frames.append(seen.number)
        heading_deg, position_m = seen.sigmas
        self.prior = replace(
            self.prior,
            pan_deg=max(self.prior.pan_deg, heading_deg),
            position_m=max(self.prior.position_m, position_m),
        )

    def thin(self) -> None:
        """Leave out every second view."""
        before = len(self.views)
        for name in ("views", "shown", "frames"):
            setattr(self, name, getattr(self, name)[::2])
        self.left_out += before - len(self.views)


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
        up = UP if not recording.info.poses_given else recording.info.gravity_up_world
        T_base_world = _found_base(found, kept, None if up is None else np.asarray(up), config)
        found.views = [
            replace(view, prior=T_base_world @ pose)
            for view, pose in zip(found.views, kept, strict=True)
        ]
    return found


def _gather_evenly(recording: Recording, config: Config, say: Say) -> Gathered:
    """Views evenly over the recording: if they become too many, every second one is left out."""
    found, every = Gathered(), 1
    for seen in _images(recording, config):
        if found.used % every == 0:
            found.add(seen._replace(T_world_camera=None), config)
            say(f"frame {seen.number}: view {len(found.views)}")
        else:
            found.left_out += 1
        found.used += 1
        if len(found.views) > config.panorama.most_views:
            found.thin()
            every *= 2
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
    sources = DepthSources(config.tof, config.structured_light, config.stereo, config.depth_sources)
    sigmas = (HEADING_DEG, config.prior.given_position_m)
    for number, frame in enumerate(recording.frames()):
        for sensor, image in sources.images(frame):
            if np.isfinite(image.z).any():
                images = _undistorted(frame, image)
                yield Seen(number, frame.stamp_s, sensor, *images, frame.T_world_camera, sigmas)
            break


def _found_base(
    found: Gathered, poses: list[Pose3], up: Float[np.ndarray, "3"] | None, config: Config
) -> Pose3:
    """T_base_world by the floor of all views; without a floor, by the vertical and the usual camera height."""
    floor = find_common(found.shown, up, np.random.default_rng(SEED), config.floor)
    if floor is not None:
        T_base_world = base_of(floor.T_level_world, poses)
        found.floor = replace(floor, plane=floor.plane.moved(T_base_world))
        return T_base_world
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


def build(
    gathered: Gathered, config: Config, rng: np.random.Generator
) -> tuple[Panorama, Placement, Surroundings]:
    """Stitch the views and extract obstacles and gaps."""
    stitching = StitchConfig(moving=config.panorama.by_pictures, prior=gathered.prior)
    views = gathered.views
    placement = place(views, rng, stitching)
    if config.panorama.by_pictures:
        placement = _levelled(gathered, placement, config)
    placed = placement.placed
    panorama = Panorama(placed, placement.links, render(views, placed, stitching.px_per_deg))
    return panorama, placement, surroundings(panorama, views)


def _levelled(gathered: Gathered, placement: Placement, config: Config) -> Placement:
    """Views that pictures alone have placed, above the floor that they show together."""
    numbers = [number for number, one in enumerate(placement.placed) if one is not None]
    poses = [one.T_base_camera for one in placement.placed if one is not None]
    gathered.shown = [
        gathered.shown[number]._replace(T_world_camera=pose)
        for number, pose in zip(numbers, poses, strict=True)
    ]
    T_base_first = _found_base(gathered, poses, None, config)
    priors: list[Prior | None] = [None] * len(placement.placed)
    priors[numbers[0]] = anchor(T_base_first @ poses[0])
    return placement._replace(placed=adjust(priors, placement.links, rotations_only=False))


def run_panorama(job: Job, say: Say) -> dict[str, Any]:
    """Make the panorama of a recording and write its files.

    Args:
        job: The recording, with depth of any kind, and the output folder.
        say: Progress.

    Returns:
        The content of `panorama.json`. Its entry `failed` says why a panorama of fewer than half of the views is none; it
        is null otherwise.

    Raises:
        RecordingError: No frame has depth and, unless pictures alone place the views, a pose.
        OutputError: The folder cannot be written.
    """
    recording, folder = job.recording, job.folder
    gathered = gather(recording, job.config, say)
    if not gathered.views:
        raise RecordingError(
            f"{recording.info.name}: none of its frames has a depth image with a pose; a panorama needs one, "
            "or --by-pictures, which needs no poses"
        )
    say(f"stitching {len(gathered.views)} views")
    panorama, placement, around = build(gathered, job.config, np.random.default_rng(SEED))
    drawing = panorama.drawing
    assert drawing is not None, "one view defines the base, so it is placed"
    content = _content(gathered, panorama, placement.reasons, around)
    cloud, _ = drawing.points()
    with folder.staged() as stage:
        clouds.save_ply(stage / "panorama.ply", cloud)
        np.savez_compressed(
            stage / "panorama.npz",
            range_m=drawing.range_m,
            sigma_m=drawing.sigma_m,
            stamp_s=drawing.stamp_s,
            view=drawing.view,
            centre=drawing.centre,
        )
        with style.styled():
            picture = style.png(plots_panorama.obstacles(drawing, around))
        (stage / "panorama_obstacles.png").write_bytes(picture)
        text = json.dumps(content, indent=2) + "\n"
        (stage / "panorama.json").write_text(text, encoding="utf-8")
    job.finish(
        gathered.used,
        count_reasons([reason for _, reason in recording.skipped]),
        views=len(gathered.views),
        views_placed=sum(view["placed"] for view in content["views"]),
        placed_by=content["placed_by"],
        failed=content["failed"],
        obstacles=len(content["obstacles"]),
        gaps=len(content["gaps"]),
        floor_seen=content["floor_seen"],
    )
    return content


def _content(
    gathered: Gathered, panorama: Panorama, reasons: dict[int, str], around: Surroundings
) -> dict[str, Any]:
    drawing = panorama.drawing
    assert drawing is not None
    views = []
    for k, (number, view, found) in enumerate(
        zip(gathered.frames, gathered.views, panorama.placed, strict=True)
    ):
        row: dict[str, Any] = {"frame": number, "stamp": view.stamp_s, "placed": found is not None}
        if found is None:
            row["reason"] = reasons[k]
        else:
            row |= {
                "by": found.by,
                "pairs": found.links,
                "T_base_camera": found.T_base_camera.matrix.tolist(),
                "sigma_deg": np.degrees(np.sqrt(np.diag(found.covariance)[:3])).tolist(),
                "sigma_m": np.sqrt(np.diag(found.covariance)[3:]).tolist(),
            }
        views.append(row)
    sphere = asdict(drawing.sphere)
    by = [one.by for one in panorama.placed if one is not None]
    return {
        "views": views,
        "placed_by": {one: by.count(one) for one in sorted(set(by))},
        "failed": _failure(len(by), len(views)),
        "left_out": gathered.left_out,
        "floor_seen": gathered.floor is not None,
        "floor": _floor(gathered.floor, panorama),
        "sphere": {name: float(value) for name, value in sphere.items()},
        "centre": drawing.centre.tolist(),
        "obstacles": [_row(one) for one in around.obstacles],
        "gaps": [_row(gap) for gap in around.gaps],
    }


def panorama_lines(content: dict[str, Any]) -> list[str]:
    """The content of `panorama.json` for the terminal: what was placed, and why the rest was not."""
    views, floor = content["views"], content["floor"]
    by = ", ".join(f"{count} by {name}" for name, count in content["placed_by"].items())
    height = (
        "floor not seen (heights refer to the expected floor)"
        if floor is None
        else f"first camera {floor['camera_height_m']:.2f} ± {floor['sigma_m']:.2f} m above the floor"
    )
    missing = [view for view in views if not view["placed"]]
    return [
        f"{len(views) - len(missing)} of {len(views)} views placed ({by}), "
        f"{len(content['obstacles'])} obstacles",
        height,
        *(f"frame {view['frame']} not placed: {view['reason']}" for view in missing),
    ]


def _failure(placed: int, views: int) -> str | None:
    """Why the panorama has failed; None if it has not."""
    if placed >= LEAST_PLACED * views:
        return None
    return f"only {placed} of {views} views could be placed, at least {LEAST_PLACED:.0%} are needed"


def _floor(floor: CommonFloor | None, panorama: Panorama) -> dict[str, Any] | None:
    """The height of the first camera above the floor, and how sure height and tilt are."""
    if floor is None:
        return None
    first = next(one for one in panorama.placed if one is not None)
    height_m, sigma_m = floor.height_of(first.T_base_camera.position)
    return {
        "views": len(floor.views),
        "camera_height_m": height_m,
        "sigma_m": sigma_m,
        "sigma_deg": np.degrees(np.sqrt(np.diag(floor.plane.covariance)[:2])).tolist(),
        "covariance": floor.plane.covariance.tolist(),
    }


def _row(one: PanoramaObstacle | PanoramaGap) -> dict[str, Any]:
    """The dataclass as JSON: lists, and null for an unknown value."""
    found: dict[str, Any] = json.loads(json.dumps(asdict(one)), parse_constant=lambda name: None)
    return found


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
