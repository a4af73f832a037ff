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
import re
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from mapping.io import clouds
from mapping.panorama.adjustment import Prior, adjust, anchor
from mapping.panorama.obstacles import PanoramaGap, PanoramaObstacle, Surroundings
from mapping.panorama.rendering import render
from mapping.panorama.sizes import surroundings
from mapping.panorama.stitching import Panorama, Placement, StitchConfig, place
from perception.floor.common_floor import CommonFloor
from perception.primitives.errors import RecordingError

from ..config.schema import Config
from ..progress import Say
from ..report.plots import panorama as plots_panorama
from ..report.plots import style
from .camera_moments import CameraMoments
from .job import Job, count_reasons
from .panorama_views import Gathered, found_base, gather

SEED = 43  # of the RANSAC that matches pictures
LISTED = 8  # missing views listed on the terminal
LEAST_PLACED = 0.5  # ours: with fewer of the views in place, most of the surroundings are missing


def build(
    gathered: Gathered, config: Config, rng: np.random.Generator
) -> tuple[Panorama, Placement, Surroundings]:
    """Stitch the views and extract obstacles and gaps; without a floor there is nothing to measure them from."""
    stitching = StitchConfig(moving=config.panorama.by_pictures, prior=gathered.prior)
    views = gathered.views
    placement = place(views, rng, stitching)
    if config.panorama.by_pictures:
        placement = _levelled(gathered, placement, config)
    placed = placement.placed
    panorama = Panorama(placed, placement.links, render(views, placed, stitching.px_per_deg))
    around = Surroundings((), ()) if gathered.floor is None else surroundings(panorama, views)
    return panorama, placement, around


def _levelled(gathered: Gathered, placement: Placement, config: Config) -> Placement:
    """Views that pictures alone have placed, above the floor that they show together."""
    numbers = [number for number, one in enumerate(placement.placed) if one is not None]
    poses = [one.T_base_camera for one in placement.placed if one is not None]
    gathered.shown = [
        gathered.shown[number]._replace(T_world_camera=pose)
        for number, pose in zip(numbers, poses, strict=True)
    ]
    T_base_first = found_base(gathered, poses, None, config)
    priors: list[Prior | None] = [None] * len(placement.placed)
    priors[numbers[0]] = anchor(T_base_first @ poses[0])
    return placement._replace(placed=adjust(priors, placement.links, rotations_only=False))


def run_panorama(job: Job, say: Say) -> dict[str, Any]:
    """Make the panorama of a recording and write its files.

    Args:
        job: The recording, with depth of any kind, and the output folder.
        say: Progress.

    Returns:
        The content of `panorama.json`. Its entry `failed` says why a panorama of fewer than half of the views is none, or
        why obstacles are not known; it is null otherwise.

    Raises:
        RecordingError: No frame has depth and, unless pictures alone place the views, a pose.
        OutputError: The folder cannot be written.
    """
    recording, folder = job.recording, job.folder
    config = replace(job.config, floor=job.config.floor_of(recording.info.calibrated))
    gathered = gather(recording, config, say)
    if not gathered.views:
        raise RecordingError(
            f"{recording.info.name}: none of its frames has a depth image with a pose; a panorama needs one, "
            "or --by-pictures, which needs no poses"
        )
    say(f"stitching {len(gathered.views)} views")
    panorama, placement, around = build(gathered, config, np.random.default_rng(SEED))
    drawing = panorama.drawing
    assert drawing is not None, "one view defines the base, so it is placed"
    content = _content(gathered, panorama, placement.reasons, around)
    cloud, _ = drawing.points()
    with folder.staged() as stage:
        clouds.save_ply(stage / "panorama.ply", cloud, None, drawing.attributes())
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
    _write_moments(job, gathered, panorama)
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


def _write_moments(job: Job, gathered: Gathered, panorama: Panorama) -> None:
    """Write every placed view to estimates.mcap."""
    moments = CameraMoments(job.folder, job.config, every_s=0.0, picture_every_s=0.0)
    for view, found in zip(gathered.views, panorama.placed, strict=True):
        if found is not None:
            picture = None if view.grey is None else np.repeat(view.grey[..., None], 3, axis=2)
            camera, T = view.depth.camera, found.T_base_camera
            moments.add(view.stamp_s, gathered.sensor, camera, T, view.depth, picture)
    moments.close()


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
            row["reason"] = _with_frames(reasons[k], gathered.frames)
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
        "failed": _failure(len(by), len(views), gathered.floor is not None),
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
        "floor not found (heights refer to the expected floor)"
        if floor is None
        else f"first camera {floor['camera_height_m']:.2f} ± {floor['sigma_m']:.2f} m above the floor"
    )
    missing = [view for view in views if not view["placed"]]
    return [
        f"{len(views) - len(missing)} of {len(views)} views placed ({by}), "
        f"{len(content['obstacles'])} obstacles",
        height,
        *(f"frame {view['frame']} not placed: {view['reason']}" for view in missing[:LISTED]),
        *(
            [f"and {len(missing) - LISTED} more, see panorama.json"]
            if len(missing) > LISTED
            else []
        ),
    ]


def _with_frames(reason: str, frames: list[int]) -> str:
    """A reason with the numbers of frames in place of those of views."""
    return re.sub(r"\bview (\d+)", lambda found: f"frame {frames[int(found[1])]}", reason)


def _failure(placed: int, views: int, floor_seen: bool) -> str | None:
    """Why the panorama has failed; None if it has not."""
    if placed < LEAST_PLACED * views:
        return f"only {placed} of {views} views could be placed, at least {LEAST_PLACED:.0%} are needed"
    if not floor_seen:
        return (
            "no floor was found, so obstacles and gaps are not known; let the views show it, and state which way is "
            "up in the world of the poses (world.up)"
        )
    return None


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
