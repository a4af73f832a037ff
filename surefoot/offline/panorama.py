"""The panoramic map of a recording: depth views from about one place, stitched, and the obstacles and gaps in it.

The pipeline gives the camera pose of each frame; `view_selection` chooses the frames that become views. Without
poses, or if they are not to be used, the pictures alone determine how the views lie to each other.

Files: `panorama.ply` (cloud), `panorama.npz` (range and its standard deviation on the sphere), `panorama.json`
(views, obstacles and gaps with their standard deviations), `panorama_obstacles.png`.

Source: seed 004, sections 2.2 and 2.3 of its paper; views of a walking camera are ours.
"""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import cv2
import numpy as np
from jaxtyping import UInt8

from mapping.io import clouds
from mapping.panorama.obstacles import PanoramaGap, PanoramaObstacle, Surroundings
from mapping.panorama.sizes import surroundings
from mapping.panorama.stitching import Panorama, StitchConfig, stitch
from mapping.panorama.views import PriorConfig, View, view_of_depth
from perception.primitives.errors import RecordingError
from perception.primitives.frame import Depth, Frame
from perception.primitives.gaussian import Gaussian
from perception.primitives.pose import Pose2, Pose3

from ..config.schema import Config
from ..recordings.recording import Recording
from ..report.plots import panorama as plots_panorama
from ..report.plots import style
from ..run.pipeline import Pipeline
from .job import Job, Say, count_reasons

FARTHEST_M = 5.0  # ours: range that is white in the pictures in which features are found
SEED = 43  # of the RANSAC that matches pictures


@dataclass(eq=False)
class Gathered:
    """The views of one place.

    Args:
        views: Views with prior poses in the base frame. Its origin is on the floor below the first camera; x is the
            mean viewing direction, or that of the first view if only the pictures place the views.
        frames: Frame number of each view.
        prior: Standard deviations of the prior poses, from the pose covariance.
        left_out: Frames that were too far from the first view, or too many.
        floor_seen: Whether a view shows the floor; otherwise heights refer to the expected floor.
        used: Frames that could be placed over a floor.
    """

    views: list[View] = field(default_factory=list)
    frames: list[int] = field(default_factory=list)
    prior: PriorConfig = field(default_factory=PriorConfig)
    left_out: int = 0
    floor_seen: bool = False
    used: int = 0


def gather(recording: Recording, config: Config, say: Say) -> Gathered:
    """Select the views of a recording.

    Args:
        recording: A recording with depth of any kind.
        config: Settings; [panorama] selects the views.
        say: Progress.
    """
    pipeline, found, wanted = Pipeline(config, recording.info), Gathered(), config.panorama
    T_base_map: Pose3 | None = None
    kept: list[Pose3] = []
    for number, frame in enumerate(recording.frames()):
        estimate = pipeline.cycle(frame).estimate
        if not estimate.views:
            continue
        found.used += 1
        seen = estimate.views[0]
        if T_base_map is None:
            T_base_map = _base(seen.T_map_camera).inverse()
        pose = T_base_map @ seen.T_map_camera
        if not (wanted.by_pictures or wanted.is_new(pose, kept)):
            continue
        if len(kept) >= wanted.most_views or not wanted.is_near(pose, kept):
            found.left_out += 1
            continue
        kept.append(pose)
        prior = pose if not wanted.by_pictures or len(kept) == 1 else None
        picture = _picture(frame, seen.depth)
        found.views.append(view_of_depth(seen.depth, FARTHEST_M, picture, prior, frame.stamp_s))
        found.frames.append(number)
        found.floor_seen |= seen.seen is not None
        found.prior = _looser(found.prior, estimate.pose)
        say(f"frame {number}: view {len(kept)}")
    if not wanted.by_pictures and kept:
        ahead = np.mean([pose.rotation[:, 2] for pose in kept], axis=0)
        turned = Pose2(0.0, 0.0, -math.atan2(ahead[1], ahead[0])).lifted()
        found.views = [replace(v, prior=turned @ p) for v, p in zip(found.views, kept, strict=True)]
    return found


def build(
    gathered: Gathered, by_pictures: bool, rng: np.random.Generator
) -> tuple[Panorama, Surroundings]:
    """Stitch the views and extract obstacles and gaps."""
    config = StitchConfig(moving=by_pictures, prior=gathered.prior)
    panorama = stitch(gathered.views, rng, config)
    return panorama, surroundings(panorama, gathered.views)


def run_panorama(job: Job, say: Say) -> dict[str, Any]:
    """Make the panorama of a recording and write its files.

    Args:
        job: The recording, with depth of any kind, and the output folder.
        say: Progress.

    Returns:
        The content of `panorama.json`.

    Raises:
        RecordingError: No frame could be placed over a floor.
        OutputError: The folder cannot be written.
    """
    recording, folder = job.recording, job.folder
    gathered = gather(recording, job.config, say)
    if not gathered.views:
        raise RecordingError(
            f"{recording.info.name}: none of its frames has depth that could be placed over a floor; "
            "a panorama needs at least one"
        )
    say(f"stitching {len(gathered.views)} views")
    by_pictures = job.config.panorama.by_pictures
    panorama, around = build(gathered, by_pictures, np.random.default_rng(SEED))
    drawing = panorama.drawing
    assert drawing is not None, "the first view has a prior, so it is placed"
    content = _content(gathered, panorama, around)
    points, _ = drawing.points()
    with folder.staged() as stage:
        clouds.save_ply(stage / "panorama.ply", points)
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
        obstacles=len(content["obstacles"]),
        gaps=len(content["gaps"]),
        floor_seen=gathered.floor_seen,
    )
    return content


def _content(gathered: Gathered, panorama: Panorama, around: Surroundings) -> dict[str, Any]:
    drawing = panorama.drawing
    assert drawing is not None
    views = []
    for number, view, place in zip(gathered.frames, gathered.views, panorama.placed, strict=True):
        row: dict[str, Any] = {"frame": number, "stamp": view.stamp_s, "placed": place is not None}
        if place is not None:
            row |= {
                "by": place.by,
                "pairs": place.links,
                "T_base_camera": place.T_base_camera.matrix.tolist(),
                "sigma_deg": np.degrees(np.sqrt(np.diag(place.covariance)[:3])).tolist(),
                "sigma_m": np.sqrt(np.diag(place.covariance)[3:]).tolist(),
            }
        views.append(row)
    sphere = asdict(drawing.sphere)
    return {
        "views": views,
        "left_out": gathered.left_out,
        "floor_seen": gathered.floor_seen,
        "sphere": {name: float(value) for name, value in sphere.items()},
        "centre": drawing.centre.tolist(),
        "obstacles": [_row(one) for one in around.obstacles],
        "gaps": [_row(gap) for gap in around.gaps],
    }


def _row(one: PanoramaObstacle | PanoramaGap) -> dict[str, Any]:
    """The dataclass as JSON: lists, and null for an unknown value."""
    found: dict[str, Any] = json.loads(json.dumps(asdict(one)), parse_constant=lambda name: None)
    return found


def _base(T_map_camera: Pose3) -> Pose3:
    """T_map_base: on the floor z = 0 below a camera, x in its viewing direction."""
    x, y, _ = T_map_camera.position.tolist()
    ahead = T_map_camera.rotation[:, 2]
    return Pose2(x, y, math.atan2(ahead[1], ahead[0])).lifted()


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


def _looser(prior: PriorConfig, pose: Gaussian | None) -> PriorConfig:
    """The prior with standard deviations no smaller than those of the pose it comes from."""
    if pose is None:
        return prior
    sigmas = np.sqrt(np.diag(pose.covariance))
    return replace(
        prior,
        pan_deg=max(prior.pan_deg, math.degrees(float(sigmas[2]))),
        position_m=max(prior.position_m, float(sigmas[:2].max())),
    )
