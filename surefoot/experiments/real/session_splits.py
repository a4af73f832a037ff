"""Recordings of one place cut into sessions, mapped one by one, and merged in many orders.

A recording is cut into stretches of equal length that share no image. Each is mapped on its own, without poses, by
`surefoot map`, so that it has axes and drift of its own. The cross-session ATE is the RMS distance of the cameras of
all sessions from the truth after one rigid alignment of all of them together.

Source: ours; ATE: Sturm et al. 2012.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from perception.primitives.frame import Frame

from ...config.schema import Config
from ...evaluation.metrics.averages import rms
from ...evaluation.metrics.trajectory import Alignment, align, associate, distances
from ...offline.job import TRUTH, Job
from ...offline.map import map_recording
from ...offline.merge import merge
from ...progress import Say, silent
from ...results.run_folder import RunFolder
from ..support import real_data
from ..support.handheld import record
from .replica_room import ReplicaRoom

SESSIONS = 6
REPLICA_EVERY = 8  # of its 2000 frames
JUMP_S = 122.0 / 30.0  # between frames 120 and 124 of the kitchen its truth jumps
FILES = (
    "trajectory.txt", "space_covariance.csv", "trajectory_covariance.csv", "graph.g2o", "mesh.ply", "cloud.ply", "map.pgm",
    "map.yaml", "layers.npz", "map_probability.png", "map_layers.tif", "sessions.json", "changes.json",
)  # fmt: skip
"""Files of a merged map that must be the same in every order."""


@dataclass(frozen=True, eq=False)
class Aligned:
    """The cameras of a merged map beside the truth.

    Args:
        found, true: Positions in the map and in the truth, m.
        session: Number of the session of each.
        stamps: Of each, on the clock of its recording, s.
        alignment: The one rigid motion from the map to the truth.
    """

    found: Float[np.ndarray, "n 3"]
    true: Float[np.ndarray, "n 3"]
    session: Float[np.ndarray, "n"]
    stamps: Float[np.ndarray, "n"]
    alignment: Alignment

    @property
    def errors_m(self) -> Float[np.ndarray, "n"]:
        """Distance of every camera from the truth."""
        return distances(self.alignment.apply(self.found), self.true)


def aligned(folder: Path) -> Aligned | None:
    """The first part of a merged map beside the truth of its sessions; None if a session is not in it."""
    run = RunFolder.open(folder)
    content, found = run.read_json("sessions.json"), run.read_trajectory("trajectory.txt")
    assert content is not None
    assert found is not None
    mine, true, session, stamps = [], [], [], []
    for one in content["sessions"]:
        if one["part"] != 1:
            return None
        truth = RunFolder.open(Path(one["map"])).read_trajectory(TRUTH)
        assert truth is not None
        ours, theirs = associate(found.stamps, truth.stamps + one["shift_s"], 1e-3)
        mine.append(found.positions[ours])
        true.append(truth.positions[theirs])
        session += [float(one["session"])] * len(ours)
        stamps.append(truth.stamps[theirs])
    all_found, all_true = np.concatenate(mine), np.concatenate(true)
    best = align(all_found, all_true)
    if best is None:
        return None
    return Aligned(all_found, all_true, np.array(session), np.concatenate(stamps), best)


def apart_ate_m(found: Aligned, stamp_s: float) -> float:
    """RMS error where the images before and after a stamp are aligned each on their own."""
    errors = []
    for part in (found.stamps < stamp_s, found.stamps >= stamp_s):
        best = align(found.found[part], found.true[part])
        assert best is not None
        errors.append(distances(best.apply(found.found[part]), found.true[part]))
    return rms(np.concatenate(errors))


def kitchen_sessions(parts: Sequence[str], count: int, place: Path, most: int | None) -> list[Path]:
    """Recordings of parts of 7-Scenes' red kitchen, cut together into sessions; no session spans two parts.

    Args:
        parts: "sweep", "pan" or both.
        count: Sessions of all parts together.
        place: Folder for them.
        most: Images of a part at most; None: all.
    """
    found = []
    for part in parts:
        source = real_data.folder(f"sevenscenes_redkitchen/{part}")
        depths = sorted(source.glob("*.depth.png"))[:most]
        for k, some in enumerate(np.array_split(np.array(depths), count // len(parts))):
            folder = place / f"{part}-{k + 1}"
            folder.mkdir(parents=True)
            (folder / "camera-intrinsics.txt").symlink_to(
                source.parent.resolve() / "camera-intrinsics.txt"
            )
            for depth in some:
                for image in source.resolve().glob(f"{depth.name.removesuffix('.depth.png')}.*"):
                    (folder / image.name).symlink_to(image)
            found.append(folder)
    return found


def replica_sessions(count: int, place: Path, seed: int) -> list[Path]:
    """Recordings of Replica's office, ray cast with noise, cut into sessions."""
    place.mkdir(parents=True)
    room = ReplicaRoom(real_data.folder("replica_office0"))
    length = -(-len(range(0, len(room.poses), REPLICA_EVERY)) // count)
    seen = room.frames(np.random.default_rng(seed), REPLICA_EVERY)
    return [
        record(place / f"office-{k + 1}.mcap", f"office-{k + 1}", _some(seen, length))
        for k in range(count)
    ]


def _some(seen: Iterator[Frame], count: int) -> Iterator[Frame]:
    """The next frames."""
    for _, frame in zip(range(count), seen, strict=False):
        yield frame


def mapped(recordings: Sequence[Path], say: Say, ignore_poses: bool = True) -> list[Path]:
    """Map folders of the recordings, by default each without the poses that came with it."""
    found = []
    for recording in recordings:
        say(f"map of {recording.name}")
        config = replace(Config(), ignore_poses=ignore_poses)
        out = recording.with_name(f"{recording.stem}-map")
        found.append(
            Path(map_recording(Job.open("map", recording, None, config, out), silent).folder)
        )
    return found


def merged_in_orders(
    maps: Sequence[Path], place: Path, orders: int, seed: int, say: Say
) -> tuple[Path, float]:
    """Merge in random orders, the first as given.

    Returns:
        The first merged map, and the share of the other orders whose files are all the same bytes.
    """
    rng = np.random.default_rng(seed)
    first: dict[str, bytes] = {}
    same = []
    for number in range(orders):
        say(f"merge in order {number + 1} of {orders}")
        order = rng.permutation(len(maps)).tolist() if number else range(len(maps))
        out = place / f"merged-{number + 1}"
        merge([maps[k] for k in order], out, silent, report=False)
        content = {name: (out / name).read_bytes() for name in FILES if (out / name).is_file()}
        first = first or content
        same.append(content == first)
    return place / "merged-1", float(np.mean(same))
