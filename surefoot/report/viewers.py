"""The estimates of a run for other viewers: a layout of Foxglove's panels, and a file of rerun.

Foxglove opens estimates.mcap itself. Rerun's importer draws its frames, pictures and log, but neither grid nor scenes,
so the same moments are written again for it.
"""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from perception.primitives.errors import InputError, OutputError
from perception.primitives.obstacle import MOVING
from perception.primitives.pose import Pose2, Pose3

from ..results.moment import UNKNOWN, Layers, Moment
from ..results.moments import read_moments
from ..results.run_folder import RunFolder

RED, GREY = (217, 64, 51), (128, 128, 128)
TALL_M = 0.4  # drawn height of an occupied cell whose top was not measured


def write_layout(out: Path) -> Path:
    """Write the layout of panels for Foxglove.

    Raises:
        OutputError: The file cannot be written.
    """
    text = resources.files(__package__).joinpath("foxglove_layout.json").read_text("utf-8")
    try:
        out.write_text(text, encoding="utf-8")
    except OSError as error:
        raise OutputError(f"cannot write {out}: {error.strerror}; choose another file") from error
    return out


def write_rerun(run: RunFolder, out: Path) -> Path:
    """Write the moments of a run as a file of rerun, on the timeline `time`, which begins at zero.

    Raises:
        InputError: rerun is not installed.
        RecordingError: The run has no estimates.
        OutputError: The file cannot be written.
    """
    try:
        import rerun as rr
    except ImportError as error:
        raise InputError("rerun is not installed; pip install 'surefoot[rerun]'") from error
    stream = rr.RecordingStream("surefoot", recording_id=run.root.resolve().name)
    try:
        stream.save(out)
    except Exception as error:  # of rerun's own kinds
        raise OutputError(f"cannot write {out}: {error}; choose another file") from error
    stream.log("map", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    start_s = None
    for moment in read_moments(run):
        start_s = moment.stamp_s if start_s is None else start_s
        stream.set_time("time", duration=moment.stamp_s - start_s)
        _log(rr, stream, moment)
    stream.flush()
    return out


def _log(rr: Any, stream: Any, moment: Moment) -> None:
    """One moment."""
    if moment.pose is not None:
        height_m = 0.0 if moment.heights_m is None else float(moment.heights_m[0])
        body = Pose3((0.0, 0.0, height_m)) @ Pose2(*moment.pose.mean.tolist()).lifted()
        stream.log("map/body", _transform(rr, body), rr.TransformAxes3D(0.2))
        sigma = np.sqrt(np.diag(moment.pose.covariance))
        for name, value in zip(("x_m", "y_m", "yaw_rad"), sigma, strict=True):
            stream.log(f"sigma/{name}", rr.Scalars(float(value)))
    for sensor, pose in moment.cameras.items():
        lens, place = moment.lenses[sensor], f"map/{sensor}"
        stream.log(place, _transform(rr, pose))
        share = 1.0
        if moment.depth is not None and moment.depth_sensor == sensor:
            share = moment.depth.shape[1] / lens.width
        size = [lens.width * share, lens.height * share]
        stream.log(
            place,
            rr.Pinhole(image_from_camera=lens.matrix * [[share], [share], [1]], resolution=size),
        )
    if moment.depth is not None:
        depth_m = moment.depth * np.float32(moment.depth_step_m)
        stream.log(f"map/{moment.depth_sensor}/depth", rr.DepthImage(depth_m, meter=1.0))
    if moment.colour is not None:
        picture = rr.EncodedImage(contents=moment.colour, media_type="image/jpeg")
        stream.log("camera", picture)
    if moment.grid is not None:
        stream.log("map/obstacles", _cells(rr, moment.grid))
    if moment.surfaces is not None:
        outlines = [np.vstack([one.corners, one.corners[:1]]) for one in moment.surfaces]
        stream.log("map/surfaces", rr.LineStrips3D(outlines, colors=GREY))
    stream.log("map/tracks", _tracks(rr, moment))
    if moment.why:
        route = np.pad(moment.route, ((0, 0), (0, 1)))
        stream.log(
            "map/route", rr.LineStrips3D([route] if len(route) else [], colors=(51, 166, 77))
        )
        stream.log(
            "map/steps", rr.Points3D(np.pad(moment.steps[:, :2], ((0, 0), (0, 1))), radii=0.02)
        )
        stream.log("why", rr.TextLog(moment.why))
        if moment.risk is not None:
            stream.log("risk", rr.Scalars(moment.risk))


def _transform(rr: Any, pose: Pose3) -> Any:
    return rr.Transform3D(translation=pose.translation, quaternion=list(pose.quat_xyzw))


def _cells(rr: Any, grid: Layers) -> Any:
    """The occupied cells as boxes."""
    occupied = (grid.probability != UNKNOWN) & (grid.probability >= 127)
    row, column = np.nonzero(occupied)
    height = np.nan_to_num(grid.height_m[occupied], nan=TALL_M).clip(0.01)
    middle = grid.origin + (np.stack([column, row], axis=1) + 0.5) * grid.cell_m
    half = np.full((len(row), 3), grid.cell_m / 2)
    half[:, 2] = height / 2
    return rr.Boxes3D(centers=np.column_stack([middle, height / 2]), half_sizes=half)


def _tracks(rr: Any, moment: Moment) -> Any:
    """The tracks as ellipsoids, as wide as their discs."""
    tracks = moment.tracks
    return rr.Ellipsoids3D(
        centers=[[*one.position.tolist(), one.height_m / 2] for one in tracks],
        half_sizes=[[one.radius_m, one.radius_m, one.height_m / 2] for one in tracks],
        colors=[RED if one.moving >= MOVING else GREY for one in tracks],
        labels=[f"{one.track}: moves {one.moving:.0%}" for one in tracks],
    )
