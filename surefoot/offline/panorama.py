"""The panoramic environment map of a recording: views from about one place, all at once, and what stands there.

The pipeline says where the camera was in each frame; a frame becomes a view when the camera has turned or
moved on. Views too far from the first are left out: a panorama has one centre. Where nobody knows the
camera's way (or nobody shall be asked) the pictures alone say how the views lie to each other.

Files: `panorama.ply` (Open3D cloud), `panorama.npz` (range and its sigma on the sphere), `panorama.json` (views, things
and gaps with their deviations), `panorama_obstacles.png`.

Source: seed 004, sections 2.2 and 2.3 of its paper; views of a walking camera are ours.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import UInt8

from mapping.io import atomic_write, clouds
from mapping.panorama.obstacles import PanoramaGap, PanoramaObstacle, Surroundings
from mapping.panorama.sizes import surroundings
from mapping.panorama.stitching import Panorama, StitchConfig, stitch
from mapping.panorama.views import PriorConfig, View, view_of_depth
from perception.primitives.errors import ConfigError, RecordingError
from perception.primitives.frame import Depth, Frame
from perception.primitives.gaussian import Gaussian
from perception.primitives.pose import Pose2, Pose3

from ..config.schema import Config
from ..recordings.recording import Recording
from ..report.plots import panorama as plots_panorama
from ..report.plots import style
from ..run.pipeline import Pipeline

FARTHEST_M = 5.0  # range that is white in the pictures that features are found in
SEED = 43


@dataclass(frozen=True)
class GatherConfig:
    """Which frames become views."""

    every_deg: float = 12.0  # ours: turned so far since the last view; a third of a narrow view
    every_m: float = 0.15  # ours: or moved so far
    near_m: float = 0.75  # ours: views further from the first are of another place
    most: int = 40  # ours: views; pairs grow with the square

    def __post_init__(self) -> None:
        for name in ("every_deg", "every_m", "near_m"):
            if not getattr(self, name) > 0.0:
                raise ConfigError(f"panorama: {name}={getattr(self, name)} must be positive")
        if self.most < 1:
            raise ConfigError(f"panorama: most={self.most} views; expected at least 1")


@dataclass(eq=False)
class Gathered:
    """Views of one place.

    Args:
        views: With priors in the base frame: on the floor below the first camera, x the middle of where all
            views look; below it and ahead of it where pictures alone must do.
        frames: Number of the frame of each.
        prior: How far the priors may be trusted, by the pose's own covariance.
        left_out: Frames that would have been views but were elsewhere, or too many.
        floor_seen: Whether any view saw the floor; else heights rest on where it was expected.
    """

    views: list[View] = field(default_factory=list)
    frames: list[int] = field(default_factory=list)
    prior: PriorConfig = field(default_factory=PriorConfig)
    left_out: int = 0
    floor_seen: bool = False


def gather(
    recording: Recording,
    config: Config,
    wanted: GatherConfig,
    by_pictures: bool,
    say: Callable[[str], None],
) -> Gathered:
    """The views of a recording.

    Args:
        recording: With depth of any kind.
        config: Of the pipeline.
        wanted: Which frames.
        by_pictures: Only the first view gets a prior; the pictures must do.
        say: Progress.
    """
    pipeline, found = Pipeline(config, recording.info), Gathered()
    T_base_map: Pose3 | None = None
    kept: list[Pose3] = []
    for number, frame in enumerate(recording.frames()):
        estimate = pipeline.cycle(frame).estimate
        if not estimate.views:
            continue
        seen = estimate.views[0]
        if T_base_map is None:
            T_base_map = _base(seen.T_map_camera).inverse()
        pose = T_base_map @ seen.T_map_camera
        if kept and not (by_pictures or _moved_on(pose, kept, wanted)):
            continue
        away = float(np.linalg.norm(pose.position - kept[0].position)) if kept else 0.0
        if len(kept) >= wanted.most or (not by_pictures and away > wanted.near_m):
            found.left_out += 1
            continue
        kept.append(pose)
        prior = pose if not by_pictures or len(kept) == 1 else None
        picture = _picture(frame, seen.depth)
        found.views.append(view_of_depth(seen.depth, FARTHEST_M, picture, prior, frame.stamp_s))
        found.frames.append(number)
        found.floor_seen |= seen.seen is not None
        found.prior = _looser(found.prior, estimate.pose)
        say(f"frame {number}: view {len(kept)}")
    if not by_pictures and kept:
        ahead = np.mean([pose.rotation[:, 2] for pose in kept], axis=0)
        turned = Pose2(0.0, 0.0, -math.atan2(ahead[1], ahead[0])).lifted()
        found.views = [replace(v, prior=turned @ p) for v, p in zip(found.views, kept, strict=True)]
    return found


def build(
    gathered: Gathered, by_pictures: bool, rng: np.random.Generator
) -> tuple[Panorama, Surroundings]:
    """Place the views, draw them, list what stands there."""
    config = StitchConfig(moving=by_pictures, prior=gathered.prior)
    panorama = stitch(gathered.views, rng, config)
    return panorama, surroundings(panorama, gathered.views)


def run_panorama(
    recording: Recording,
    folder: Path,
    say: Callable[[str], None],
    config: Config | None = None,
    wanted: GatherConfig | None = None,
    by_pictures: bool = False,
) -> dict[str, Any]:
    """Everything from a recording to the files.

    Args:
        recording: With depth of any kind.
        folder: For the files; there already.
        say: Progress.
        config: Of the pipeline.
        wanted: Which frames become views.
        by_pictures: Do not ask where the camera was.

    Returns:
        What `panorama.json` holds.

    Raises:
        RecordingError: No frame of it shows anything over a floor.
    """
    gathered = gather(recording, config or Config(), wanted or GatherConfig(), by_pictures, say)
    if not gathered.views:
        raise RecordingError(
            f"{recording.info.name}: none of its frames has depth that could be placed over a floor; "
            "a panorama needs at least one"
        )
    say(f"{len(gathered.views)} views: placing them")
    panorama, around = build(gathered, by_pictures, np.random.default_rng(SEED))
    assert panorama.drawing is not None, "the first view has a prior, so it is placed"
    told = _told(gathered, panorama, around)
    drawing = panorama.drawing
    points, _ = drawing.points()
    clouds.save_ply(folder / "panorama.ply", points)
    with (
        atomic_write.atomic_path(folder / "panorama.npz") as temporary,
        temporary.open("wb") as file,
    ):
        np.savez_compressed(
            file,
            range_m=drawing.range_m,
            sigma_m=drawing.sigma_m,
            stamp_s=drawing.stamp_s,
            view=drawing.view,
            centre=drawing.centre,
        )
    with style.styled():
        picture = style.png(plots_panorama.obstacles(drawing, around))
    for name, content in (
        ("panorama_obstacles.png", picture),
        ("panorama.json", (json.dumps(told, indent=2) + "\n").encode()),
    ):
        with atomic_write.atomic_path(folder / name) as temporary:
            temporary.write_bytes(content)
    return told


def _told(gathered: Gathered, panorama: Panorama, around: Surroundings) -> dict[str, Any]:
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
    """As JSON knows it: lists, and null for what is not known."""
    found: dict[str, Any] = json.loads(json.dumps(asdict(one)), parse_constant=lambda name: None)
    return found


def _base(T_map_camera: Pose3) -> Pose3:
    """On the floor below a camera, x where it looks; the map's floor has z = 0."""
    x, y, _ = T_map_camera.position.tolist()
    ahead = T_map_camera.rotation[:, 2]
    return Pose2(x, y, math.atan2(ahead[1], ahead[0])).lifted()


def _moved_on(pose: Pose3, kept: list[Pose3], wanted: GatherConfig) -> bool:
    """Whether no view so far was taken from about here in about this direction."""
    for other in kept:
        cosine = (float(np.trace(other.rotation.T @ pose.rotation)) - 1.0) / 2.0
        turned = math.degrees(math.acos(min(max(cosine, -1.0), 1.0)))
        moved = float(np.linalg.norm(pose.position - other.position))
        if turned < wanted.every_deg and moved < wanted.every_m:
            return False
    return True


def _picture(frame: Frame, depth: Depth) -> UInt8[np.ndarray, "h w"] | None:
    """Colour or amplitude of the same pixels as a depth image; None if there is neither."""
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
    """A prior no surer than the pose it comes from."""
    if pose is None:
        return prior
    sigmas = np.sqrt(np.diag(pose.covariance))
    return replace(
        prior,
        pan_deg=max(prior.pan_deg, math.degrees(float(sigmas[2]))),
        position_m=max(prior.position_m, float(sigmas[:2].max())),
    )
