"""Tracks of recordings in which nothing moves: how many end as moving obstacles.

A static room shows a tracker all that deceives it: other sides of an object, parts of furniture, blobs of depth noise
on the floor, jumps of the given poses. A track counts as a false mover if its probability of moving exceeds 0.5 at its
end or at its last detection. Replica's office has few depth images, so a sequence along its trajectory is ray cast
from its mesh, with the noise of structured light.

Parameters were chosen on tum_fr3_cabinet and sevenscenes_redkitchen and on walks of scene home with seeds 100 to 107;
redwood_livingroom, replica_office0, realsense_low_boxes and the ray cast sequence were only looked at afterwards.

Source: ours.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from perception.primitives.obstacle import Obstacle

from ...config.schema import Config
from ...evaluation.metrics.obstacles import MOVING, likeliest_moving
from ...recordings.recording import RecordingInfo
from ...results.run_folder import RunFolder
from ...run.pipeline import Pipeline
from ..support import real_data
from ..support.experiment import Part, Say
from .replica_room import ReplicaRoom

RENDERED = "replica_rendered"
EVERY = 25  # of Replica's 2000 frames


def part(runs: Mapping[str, Path], say: Say) -> Part:
    """False movers of finished runs of `surefoot process` on static recordings, and of the ray cast office.

    Args:
        runs: Name of the recording to the folder of its run.
        say: Progress.

    Returns:
        static_movers, the sum over all recordings, and static_movers_<name> of each; table lines.

    Raises:
        InputError: A folder holds no run, or the data of Replica are absent.
    """
    found = {}
    for name, path in runs.items():
        log = RunFolder.open(path).read_json("obstacles.json") or {}
        found[name] = log.get("tracks", [])
    say(f"{RENDERED}: tracking")
    found[RENDERED] = tracks_of(ReplicaRoom(real_data.folder("replica_office0")))
    figures: dict[str, float] = {}
    table = ["recording                  tracks  false movers  largest P(moving)"]
    for name, entries in found.items():
        likeliest = likeliest_moving(entries)
        figures[f"static_movers_{name}"] = float(sum(p > MOVING for p in likeliest.values()))
        table.append(
            f"{name:25s}  {len(likeliest):6d}  {figures[f'static_movers_{name}']:12.0f}"
            f"  {max(likeliest.values(), default=0.0):17.2f}"
        )
    return {"static_movers": sum(figures.values())} | figures, table


def tracks_of(room: ReplicaRoom, every: int = EVERY) -> list[dict[str, Any]]:
    """Tracks of every frame along the room's trajectory, with its poses, as in obstacles.json."""
    info = RecordingInfo("replica", "replica", poses_given=True, gravity_up_world=(0.0, 0.0, 1.0))
    pipeline, rng = Pipeline(Config(), info), np.random.default_rng(0)
    return [
        _entry(frame.stamp_s, obstacle)
        for frame in room.frames(rng, every)
        for obstacle in pipeline.cycle(frame).tracks
    ]


def _entry(stamp_s: float, obstacle: Obstacle) -> dict[str, Any]:
    return {
        "stamp": stamp_s,
        "track": obstacle.track,
        "moving": obstacle.moving,
        "seen": obstacle.seen_s,
    }
