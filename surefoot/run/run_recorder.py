"""The run recorder: writes the tables and pictures of a run, and its maps at the end.

Tables are written row by row, so that memory does not grow with the length of a run.
"""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from mapping.grid.rooms import rooms_of
from mapping.io import clouds, grid_file, ground_file, nav2, world_file
from perception.estimate import Estimate
from perception.filtering.consistency import Innovation
from perception.floor.segmented_view import SegmentedView
from perception.primitives.obstacle import Obstacle
from planning.planners.planner import Decision, Planner
from planning.world_model import WorldModel

from ..config import toml
from ..config.schema import Config
from ..recordings.recording import RecordingInfo
from ..results.footprint_entries import footprint_entry
from ..results.level_log import LevelLog
from ..results.measurement_log import (
    ODOMETRY,
    ODOMETRY_HEADER,
    SIGHTINGS,
    SIGHTINGS_HEADER,
    odometry_row,
    sighting_rows,
)
from ..results.moment import Moment
from ..results.room_entries import ROOMS, room_entries
from ..results.row_stream import JsonStream, RowStream
from ..results.run_folder import COVARIANCE_HEADER, RunFolder, estimate_row
from ..results.status_log import StatusLog
from ..results.timing_log import TimingLog
from ..results.version import commit, version
from ..words import count_of
from .level_pipeline import LevelPipeline
from .loop import Cycle
from .maps import RunMaps
from .moment_recorder import MomentRecorder
from .pipeline import Pipeline

UPPER = ("P00", "P01", "P02", "P11", "P12", "P22")  # elements of the plane's covariance
FLOOR_HEADER = ("stamp_s", "camera", "nx", "ny", "nz", "height_m", *UPPER, "share", "state")
INNOVATION_HEADER = ("stamp_s", "source", "identity", "whitened_0", "whitened_1")
COMMAND_HEADER = (
    "stamp_s", "forward_m", "lateral_m", "turn_rad", "pan_rad", "tilt_rad", "why", "risk",
)  # fmt: skip
VIEW_EVERY_S = 4.0  # pictures for the report: about 15 per minute
MAX_VIEWS = 60
VIEW_WIDTH_PX = 360
STAGES_WIDTH_PX = 960  # of the eight stages of the monocular cycle


class RunRecorder:
    """The tables and pictures of one run."""

    def __init__(
        self,
        folder: RunFolder,
        config: Config,
        info: RecordingInfo,
        goals: Sequence[tuple[float, float]],
        recording: str = "",
    ) -> None:
        self._folder = folder
        self._config = config
        self._info = info
        self._goals = goals
        self._recording = recording
        self.frames = 0
        self._first_s = self._last_s = 0.0
        self._farthest_m = 0.0
        self._floor_seen = 0
        self._views: list[dict[str, Any]] = []
        self._landmarks = {"accepted": 0, "rejected": 0}
        self._poses = RowStream(folder, "trajectory_covariance.csv", COVARIANCE_HEADER)
        self._floors = RowStream(folder, "floor.csv", FLOOR_HEADER)
        self._commands = RowStream(folder, "commands.csv", COMMAND_HEADER)
        self._innovations = RowStream(folder, "innovations.csv", INNOVATION_HEADER)
        self._odometry = RowStream(folder, ODOMETRY, ODOMETRY_HEADER)
        self._sightings = RowStream(folder, SIGHTINGS, SIGHTINGS_HEADER)
        self._status = StatusLog(folder)
        self._timing = TimingLog(folder)
        self._tracks = JsonStream(folder, "obstacles.json")
        self._levels = LevelLog(folder) if info.levels else None
        self._moments = MomentRecorder(folder, config, info.start is not None)
        folder.write_text("config.toml", toml.dumps(config))

    @property
    def seconds(self) -> float:
        """Time from the first to the last frame, s, by their stamps."""
        return self._last_s - self._first_s

    def note(self, cycle: Cycle) -> Moment | None:
        """Write one cycle; returns its moment, if it is one that is kept."""
        frame, estimate, decision = cycle.frame, cycle.world.estimate, cycle.decision
        stamp = estimate.stamp_s
        self._status.note(stamp, estimate.status)
        self._first_s = stamp if self.frames == 0 else self._first_s
        self._last_s = stamp
        self.frames += 1
        self._timing.note(stamp, estimate.timing_ms)
        self._odometry.append(odometry_row(stamp, frame))
        for row in sighting_rows(stamp, estimate.sightings):
            self._sightings.append(row)
        if estimate.pose is not None:
            self._poses.append(estimate_row(stamp, estimate.pose))
        if self._levels is not None and cycle.world.levels is not None:
            assert estimate.pose is not None
            self._levels.note(stamp, cycle.world.levels, estimate.pose, decision)
        for view in estimate.views:
            self._floors.append(_floor_row(stamp, view))
        self._floor_seen += any(view.seen is not None for view in estimate.views)
        for obstacle in estimate.obstacles:
            self._tracks.append(_track(stamp, obstacle))
        if estimate.landmarks is not None:
            self._landmarks["accepted"] += estimate.landmarks.accepted
            self._landmarks["rejected"] += estimate.landmarks.rejected
            for innovation in estimate.landmarks.innovations:
                self._innovations.append(_innovation(stamp, "landmark", innovation))
        for innovation in estimate.innovations:
            self._innovations.append(_innovation(stamp, "track", innovation))
        if decision is not None:
            walk, gaze = decision.walk, decision.gaze
            step = (walk.forward_m, walk.lateral_m, walk.turn_rad)
            risk = None if decision.plan is None else decision.plan.risk
            head = (gaze.pan_rad, gaze.tilt_rad)
            self._commands.append(
                (stamp, *step, *head, decision.why, np.nan if risk is None else risk)
            )
        self._keep_views(cycle)
        return self._moments.note(cycle)

    def keep_picture(self, stamp_s: float, name: str, png: bytes) -> None:
        """Add a PNG picture to the report."""
        file = f"views/{len(self._views):03d}.png"
        self._folder.write_bytes(file, png)
        caption = f"{name}, t = {stamp_s:.1f} s"
        self._views.append({"stamp": stamp_s, "name": name, "file": file, "caption": caption})

    def progress(self, world: WorldModel, planner: Planner | None) -> str:
        """One line for the terminal."""
        text = f"frame {self.frames}"
        if self._info.frames:
            text += f" of {self._info.frames}"
        text += f", t {world.stamp_s:.1f} s"
        if planner is not None:
            if self._goals:
                left_m = planner.distance_to_goal(world)
                self._farthest_m = max(self._farthest_m, left_m)
                text = f"{bar(1.0 - left_m / max(self._farthest_m, 1e-9))} {text}, {left_m:.2f} m to the goal"
            else:
                text += f", {planner.reached} places visited"
            text += f", {len(world.tracks)} tracks"
        return text

    def notes(self) -> tuple[str, ...]:
        """Notes for the user on how the recording was used."""
        seen = f"floor seen in {self._floor_seen} of {count_of(self.frames, 'frame')}"
        notes = [*([] if self._info.levels else [seen]), *self.status_notes()]
        if self._poses.rows:
            return tuple(notes)
        if self._info.poses_given and self._info.gravity_up_world is None:
            notes.append(
                "the recording has poses, but no vertical: no floor was found; give world.up"
            )
        else:
            notes.append(
                "the recording has neither poses nor footsteps: frames are processed independently, "
                "and the map shows the last frame only"
            )
        return tuple(notes)

    def status_notes(self) -> tuple[str, ...]:
        """Periods in which the estimates were doubtful, and why."""
        return self._status.notes()

    def finish(
        self, pipeline: Pipeline | LevelPipeline, summary: dict[str, Any], report: bool = True
    ) -> None:
        """Write maps, summary and, if asked for, the report and the tables, and close all files."""
        folder = self._folder
        self._close_tables(pipeline)
        if pipeline.maps is not None:
            self._write_maps(pipeline.maps)
        points, colours = pipeline.cloud.cloud()
        if len(points):
            attributes = {"sightings": pipeline.cloud.sightings}
            clouds.save_ply(folder.path("cloud.ply"), points, colours, attributes)
        ground = pipeline.ground_entries()
        if ground is not None:
            folder.write_json(ground_file.NAME, ground)
        folder.write_json("views.json", self._views)
        folder.write_json(
            "summary.json",
            {
                **{key: value for key, value in summary.items() if key != "run"},
                "name": self._info.name,
                "kind": self._info.kind,
                "start": None if self._info.start is None else self._info.start.vector.tolist(),
                "start_covariance": None
                if self._info.start_covariance is None
                else self._info.start_covariance.tolist(),
                "goal_positions": [list(goal) for goal in self._goals],
                "landmarks": [
                    [mark.identity, *mark.position, mark.side_m] for mark in self._info.landmarks
                ],
                "landmark_sightings": self._landmarks,
                "status": self._status.entries(),
                "renderer": self._config.renderer,
                "version": version(),
                "commit": commit(),
                "recording": self._recording,
                "command": summary.get("command") or self._command(),
            },
        )
        if report:
            from ..report.page import write_report
            from ..store.run_tables import write_run_tables

            write_report(folder)
            write_run_tables(folder)

    def _write_maps(self, maps: RunMaps) -> None:
        """Write the maps of one floor."""
        folder, world = self._folder, maps.world
        nav2.save(folder.root, "map", world.probability, world.known, world.origin, world.cell_m)
        world_file.save(folder.root, world)
        divided = rooms_of(world)
        if divided.rooms:
            folder.write_json(ROOMS, room_entries(divided))
        if maps.grid is not None:
            grid_file.save(folder.path("terrain.npz"), maps.grid, maps.confidence)

    def _command(self) -> str:
        """The command that repeats this run."""
        config = str(self._folder.path("config.toml"))
        if self._recording:
            return shlex.join(["surefoot", "process", self._recording, "--config", config])
        return shlex.join(["surefoot", "simulate", "--config", config])

    def _close_tables(self, pipeline: Pipeline | LevelPipeline) -> None:
        """Close all tables."""
        if self._levels is not None:
            self._levels.close()
        for table in (self._floors, self._odometry, self._sightings, self._innovations):
            table.close()
        self._commands.close(keep_empty=False)
        self._status.close()
        self._poses.close(keep_empty=False)
        if self._poses.rows and not self._folder.has(
            "trajectory.txt"
        ):  # of a camera that moves in space
            self._folder.write_planar_trajectory()
        footprints = [] if pipeline.maps is None else pipeline.maps.footprints()
        self._tracks.close_into(
            "tracks", {"footprints": [footprint_entry(one) for one in footprints]}
        )
        self._moments.finish(tuple(footprints))
        self._timing.close()

    def _keep_views(self, cycle: Cycle) -> None:
        """Every few seconds, store the camera images and the stages of a decision by colour as small pictures."""
        frame, estimate, decision = cycle.frame, cycle.world.estimate, cycle.decision
        due = not self._views or estimate.stamp_s - self._views[-1]["stamp"] >= VIEW_EVERY_S
        if not due or len(self._views) >= MAX_VIEWS:
            return
        pictures = []
        if frame.colour is not None:
            colour = cv2.cvtColor(frame.colour.rgb, cv2.COLOR_RGB2BGR)
            pictures.append(("colour", colour, VIEW_WIDTH_PX))
        for view in cycle.world.views:
            pictures.append((view.sensor, _depth_picture(view.depth.z), VIEW_WIDTH_PX))
        drawn = _stages(estimate, decision)
        if decision is not None and drawn is not None:
            pictures.append((f"stages, then {decision.why}", drawn, STAGES_WIDTH_PX))
        for name, picture, width in pictures:
            height = round(picture.shape[0] * width / picture.shape[1])
            small = cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA)
            file = f"views/{len(self._views):03d}.jpg"
            done, data = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, 80])
            if done:
                self._folder.write_bytes(file, data.tobytes())
                self._views.append(
                    {
                        "stamp": estimate.stamp_s,
                        "name": name,
                        "file": file,
                        "caption": f"{name}, t = {estimate.stamp_s:.1f} s",
                    }
                )


def bar(share: float, width: int = 20) -> str:
    """A bar for the terminal, filled to a share."""
    full = round(width * min(max(share, 0.0), 1.0))
    return f"[{'=' * full}{' ' * (width - full)}]"


def _stages(estimate: Estimate, decision: Decision | None) -> UInt8[np.ndarray, "h w 3"] | None:
    """The stages of the monocular cycle with the chosen pixel, BGR; None if the planner chose none."""
    if decision is None or decision.image_target is None or estimate.colour_floor is None:
        return None
    from ..report.plots.monocular import stages  # loaded only for these pictures

    target = decision.image_target
    result = replace(estimate.colour_floor.result, movable=target.movable)
    return np.asarray(cv2.cvtColor(stages(result, chosen_px=target.pixel), cv2.COLOR_RGB2BGR))


def _floor_row(stamp_s: float, view: SegmentedView) -> tuple[object, ...]:
    P = view.floor.covariance
    return (
        stamp_s,
        view.sensor,
        *view.floor.normal.tolist(),
        view.floor.offset_m,
        *(float(P[i, j]) for i in range(3) for j in range(i, 3)),
        0.0 if view.seen is None else view.seen,
        "expected" if view.seen is None else "seen",
    )


def _innovation(stamp_s: float, source: str, innovation: Innovation) -> tuple[object, ...]:
    identity = "" if innovation.identity is None else innovation.identity
    return (stamp_s, source, identity, *innovation.whitened.tolist())


def _track(stamp_s: float, obstacle: Obstacle) -> dict[str, Any]:
    return {
        "stamp": stamp_s,
        "track": obstacle.track,
        "mean": obstacle.state.mean.tolist(),
        "covariance": obstacle.state.covariance.tolist(),
        "radius_m": obstacle.radius_m,
        "height_m": obstacle.height_m,
        "moving": obstacle.moving,
        "modes": None if obstacle.motion is None else obstacle.motion.named,
        "seen": obstacle.seen_s,
    }


def _depth_picture(z: Float[np.ndarray, "h w"]) -> np.ndarray:
    """Depth as a colour image (viridis): near is bright, missing is black."""
    known = np.isfinite(z)
    near, far = (0.3, 3.0)
    level = np.clip((far - np.where(known, z, far)) / (far - near), 0.0, 1.0)
    picture = cv2.applyColorMap((255 * level).astype(np.uint8), cv2.COLORMAP_VIRIDIS)
    picture[~known] = 0
    return np.asarray(picture)
