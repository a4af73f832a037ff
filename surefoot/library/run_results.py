"""The results of a run as arrays, read from its folder when they are asked for."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from mapping.grid.egocentric_grid import EgocentricGrid
from mapping.io import grid_file, nav2
from mapping.io.nav2 import OccupancyMap
from mapping.objects.footprints import Footprint
from mapping.surface.traversability import load_layers

from ..results.footprint_entries import footprint_of
from ..results.run_folder import COVARIANCE_HEADER, RunFolder
from ..results.tables import Trajectory
from . import checks

FLOOR = ("nx", "ny", "nz")
UPPER = ("P00", "P01", "P02", "P11", "P12", "P22")


@dataclass(frozen=True, eq=False)
class BodyTrajectory:
    """Estimated poses of the body.

    Args:
        stamps_s: (n,), s.
        poses: (n, 3), x, y in m and yaw in rad, map frame.
        covariances: (n, 3, 3) of these; NaN where the run wrote none.
    """

    stamps_s: Float[np.ndarray, "n"]
    poses: Float[np.ndarray, "n 3"]
    covariances: Float[np.ndarray, "n 3 3"]

    def __len__(self) -> int:
        return len(self.stamps_s)


@dataclass(frozen=True, eq=False)
class TrackTable:
    """Every reported track at every frame.

    Args:
        stamps_s: (n,), time of the frame, s.
        tracks: (n,), number of the track.
        states: (n, 4), x, y in m and vx, vy in m/s, map frame.
        covariances: (n, 4, 4) of these.
        radii_m, heights_m: (n,), m.
        moving: (n,), probability of moving.
    """

    stamps_s: Float[np.ndarray, "n"]
    tracks: Int[np.ndarray, "n"]
    states: Float[np.ndarray, "n 4"]
    covariances: Float[np.ndarray, "n 4 4"]
    radii_m: Float[np.ndarray, "n"]
    heights_m: Float[np.ndarray, "n"]
    moving: Float[np.ndarray, "n"]

    def __len__(self) -> int:
        return len(self.stamps_s)


@dataclass(frozen=True, eq=False)
class FloorTable:
    """The floor in every depth image, camera frame.

    Args:
        stamps_s: (n,), s.
        sensors: (n,), name of the depth sensor.
        normals: (n, 3), up.
        heights_m: (n,), of the camera over the floor, m.
        covariances: (n, 3, 3) over (two tilts in rad, height in m), as in `Plane`.
        seen: (n,), False where no floor was found and the expected one is given.
    """

    stamps_s: Float[np.ndarray, "n"]
    sensors: tuple[str, ...]
    normals: Float[np.ndarray, "n 3"]
    heights_m: Float[np.ndarray, "n"]
    covariances: Float[np.ndarray, "n 3 3"]
    seen: Bool[np.ndarray, "n"]

    def __len__(self) -> int:
        return len(self.stamps_s)


class Run:
    """Results of `simulate`, `process`, `map`, `panorama` or `monocular`.

    Every property is read from the run folder on first use. A folder that was not named by the caller is temporary
    and is deleted together with this object.
    """

    def __init__(self, folder: Path | str) -> None:
        """Open the folder of a run, also of an earlier one or of the command line.

        Raises:
            InputError: It holds no run.
        """
        self._temporary: tempfile.TemporaryDirectory[str] | None = None
        self._files = RunFolder.open(checks.path(folder, "folder"))

    def __repr__(self) -> str:
        return f"Run({str(self.folder)!r})"

    @property
    def folder(self) -> Path:
        """Where everything of the run is."""
        return self._files.root

    @property
    def report(self) -> Path:
        """The HTML report."""
        return self._files.path("report.html")

    def path(self, name: str) -> Path:
        """A file of the run, such as "mesh.ply" or "recording.mcap", whether it exists or not."""
        return self._files.path(name)

    @cached_property
    def summary(self) -> dict[str, Any]:
        """How the run ended: frames, seconds, skipped frames by reason, goals reached, and so on."""
        return dict(self._files.read_json("summary.json") or {})

    @property
    def metrics(self) -> dict[str, Any]:
        """Figures against the truth, as `evaluate` computed them; empty before that."""
        return dict(self._files.read_json("metrics.json") or {})

    @property
    def succeeded(self) -> bool:
        """Whether every goal was reached without a fall; True for a run without goals."""
        said = self.summary
        return said.get("goals_reached") == said.get("goals") and said.get("fell_at_s") is None

    @cached_property
    def trajectory(self) -> BodyTrajectory | None:
        """Estimated poses of the body, or below the camera; None if the pose was never known."""
        table = self._files.read_csv("trajectory_covariance.csv")
        if table is not None:
            rows = table.matrix(*COVARIANCE_HEADER)
            return BodyTrajectory(rows[:, 0], rows[:, 1:4], _symmetric(rows[:, 4:], 3))
        found = self._files.read_trajectory("trajectory.txt")
        if found is None:
            return None
        poses = np.column_stack([found.positions[:, :2], found.yaws])
        return BodyTrajectory(found.stamps, poses, np.full((len(found), 3, 3), np.nan))

    @cached_property
    def poses_in_space(self) -> Trajectory | None:
        """trajectory.txt: stamps, positions (n, 3) in m, quaternions (n, 4) in x, y, z, w; None without poses.

        Poses of the body for a walking body, else of the camera.
        """
        return self._files.read_trajectory("trajectory.txt")

    @cached_property
    def tracks(self) -> TrackTable:
        """Every reported track at every frame."""
        rows = (self._files.read_json("obstacles.json") or {}).get("tracks", [])
        count = len(rows)
        return TrackTable(
            _column(rows, "stamp"),
            np.array([row["track"] for row in rows], np.int64),
            np.array([row["mean"] for row in rows], np.float64).reshape(count, 4),
            np.array([row["covariance"] for row in rows], np.float64).reshape(count, 4, 4),
            _column(rows, "radius_m"),
            _column(rows, "height_m"),
            _column(rows, "moving"),
        )

    @cached_property
    def footprints(self) -> list[Footprint]:
        """Outlines of the static obstacles on the floor, map frame; those of most points first."""
        rows = (self._files.read_json("obstacles.json") or {}).get("footprints", [])
        return [footprint_of(row) for row in rows]

    @cached_property
    def floor(self) -> FloorTable | None:
        """The floor in every depth image; None if there was none."""
        table = self._files.read_csv("floor.csv")
        if table is None:
            return None
        return FloorTable(
            table.numbers("stamp_s"),
            tuple(table.words("camera")),
            table.matrix(*FLOOR),
            table.numbers("height_m"),
            _symmetric(table.matrix(*UPPER), 3),
            np.array([word == "seen" for word in table.words("state")]),
        )

    @cached_property
    def grid(self) -> EgocentricGrid | None:
        """The egocentric grid at the end: probability, known, height_m, centres(); None without depth."""
        if not self._files.has("terrain.npz"):
            return None
        return grid_file.load(self.path("terrain.npz"))[0]

    @cached_property
    def map(self) -> OccupancyMap | None:
        """Occupancy of the whole run: probability (free 0, occupied 1, else 0.5), known, origin, cell_m."""
        return nav2.load(self.path("map.yaml")) if self._files.has("map.yaml") else None

    @cached_property
    def layers(self) -> dict[str, np.ndarray]:
        """Of `surefoot.map`: arrays of layers.npz by name (docs/outputs.md), such as elevation and traversability; else empty."""
        if not self._files.has("layers.npz"):
            return {}
        return load_layers(self.path("layers.npz"))


def opened(folder: Path, temporary: tempfile.TemporaryDirectory[str] | None) -> Run:
    """The run of a folder, which owns the temporary directory, if that is what it is in."""
    run = Run(folder)
    run._temporary = temporary
    return run


def _column(rows: list[dict[str, Any]], name: str) -> Float[np.ndarray, "n"]:
    return np.array([row[name] for row in rows], np.float64)


def _symmetric(upper: Float[np.ndarray, "n k"], size: int) -> Float[np.ndarray, "n m m"]:
    """Matrices from their upper triangles, row by row."""
    rows, columns = np.triu_indices(size)
    found = np.empty((len(upper), size, size))
    found[:, rows, columns] = upper
    found[:, columns, rows] = upper
    return found
