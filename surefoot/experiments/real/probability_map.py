"""The map of a whole run and its uncertainty: probabilities against a true mesh, and walkable floor in any axes.

Replica's office, seen along its true trajectory with noise: of the cells that claim a probability, how many hold a
surface between the lowest obstacle and the robot's top. The parameters of the map come from simulated walks.
7-Scenes' kitchen: the floor that a robot can walk on, with given poses and without.

Source: ours; reliability diagram after Murphy and Winkler 1977.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from mapping.grid.egocentric_grid import LOWEST_OBSTACLE_M
from mapping.grid.world_map import WorldMap
from perception.primitives.frame import Frame
from perception.primitives.pose import Pose3
from sim.free_space import ROBOT_TOP_M

from ...config.schema import Config
from ...offline.fusion import add_to_map
from ...offline.job import Job
from ...offline.map import map_recording
from ...offline.placed_images import GivenCamera
from ...progress import Say, silent
from ...recordings.open import open_recording
from ...recordings.recording import RecordingInfo, SkippedFrame
from ...recordings.without_poses import WithoutPoses
from ..support import real_data
from .replica_room import ReplicaRoom

EVERY = 8  # of Replica's 2000 frames: each surface is still seen about twenty times
SAMPLES = 2_000_000  # points on the true mesh, about fifty in a cell
CLAIMS = np.arange(0.0, 1.01, 0.1)  # centres of the bins of the reliability table
CLAIMED = 0.8


class RoomRecording:
    """The views of the room as a recording with given poses."""

    def __init__(self, room: ReplicaRoom, seed: int) -> None:
        self.info = RecordingInfo(
            "office0",
            "replica",
            poses_given=True,
            frames=len(room.poses[::EVERY]),
            gravity_up_world=(0.0, 0.0, 1.0),
        )
        self.skipped: list[SkippedFrame] = []
        self.remarks: list[str] = []
        self._room, self._seed = room, seed

    def frames(self) -> Iterator[Frame]:
        """The same frames in every pass."""
        yield from self._room.frames(np.random.default_rng(self._seed), EVERY)


class Claims(NamedTuple):
    """Claimed probability and true state of the seen cells."""

    probability: Float[np.ndarray, "n"]
    occupied: Bool[np.ndarray, "n"]


def claims(room: ReplicaRoom, seed: int) -> Claims:
    """Map the room, and compare every seen cell with the true mesh."""
    config = Config(seed=seed)
    source = GivenCamera(RoomRecording(room, seed), config)
    world = WorldMap(config.world_map)
    for image in source.images():
        add_to_map(world, image, float(source.frames), config)
    known = world.known
    occupied = _truly_occupied(room, world, source.T_map_world)
    return Claims(world.probability[known].astype(np.float64), occupied[known])


def _truly_occupied(
    room: ReplicaRoom, world: WorldMap, T_map_world: Pose3
) -> Bool[np.ndarray, "rows columns"]:
    """Cells of the map in which the true mesh rises above the lowest obstacle, below the robot's top."""
    points = room.mesh.sampled(SAMPLES, np.random.default_rng(0)).astype(np.float64)
    height = points[:, 2] - real_data.REPLICA_FLOOR_M
    rising = points[(height > LOWEST_OBSTACLE_M) & (height < ROBOT_TOP_M)]
    cells = world.cell_of(T_map_world.apply(rising)[:, :2])
    occupied = np.zeros(world.known.shape, np.bool_)
    inside = np.all((cells >= 0) & (cells < occupied.shape), axis=1)
    occupied[tuple(cells[inside].T)] = True
    return occupied


def reliability(found: Claims) -> list[tuple[float, int, float, float]]:
    """Centre of each bin, its number of cells, their mean claim, and the share that is occupied."""
    bins = np.rint(10.0 * found.probability).astype(int)
    table = []
    for number, centre in enumerate(CLAIMS):
        chosen = bins == number
        count = int(chosen.sum())
        table.append(
            (
                float(centre),
                count,
                float(found.probability[chosen].mean()) if count else float("nan"),
                float(found.occupied[chosen].mean()) if count else float("nan"),
            )
        )
    return table


def probabilities(seeds: int, say: Say) -> tuple[dict[str, float], list[str]]:
    """Reliability of the probability map of the office, over all seeds."""
    room = ReplicaRoom(real_data.folder("replica_office0"))
    every = []
    for seed in range(seeds):
        say(f"office: seed {seed}, probability map")
        every.append(claims(room, seed))
    pooled = Claims(
        np.concatenate([one.probability for one in every]),
        np.concatenate([one.occupied for one in every]),
    )
    table = reliability(pooled)
    share = next(right for centre, _, _, right in table if abs(centre - CLAIMED) < 1e-9)
    rows = [
        f"office, claims about {centre:.1f}   {count:6d} cells   mean claim {claim:.3f}   occupied {right:.3f}"
        for centre, count, claim, right in table
    ]
    figures = {
        "occupied_share_at_080": share,
        "occupied_share_at_080_min": share,
        "occupied_share_at_080_max": share,
    }
    return figures, rows


def kitchen(say: Say) -> tuple[dict[str, float], list[str]]:
    """Walkable floor of 7-Scenes' kitchen by `surefoot map`, with given poses over without."""
    path = real_data.folder("sevenscenes_redkitchen") / "sweep"
    walkable = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, ignored in (("given", False), ("own", True)):
            say(f"kitchen: {name} poses")
            recording = open_recording(path)
            config = replace(Config(), ignore_poses=ignored)
            job = Job.of(
                "map",
                WithoutPoses(recording) if ignored else recording,
                config,
                Path(folder) / name,
            )
            walkable[name] = map_recording(job, silent).walkable_m2
    ratio = walkable["given"] / max(walkable["own"], 1e-9)
    figures = {"walkable_ratio": ratio, "walkable_given_m2": walkable["given"]}
    return figures, [
        f"kitchen              walkable with given poses {walkable['given']:.2f} m^2, without {walkable['own']:.2f} m^2"
    ]
