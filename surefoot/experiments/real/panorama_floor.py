"""The floor of panoramas with given poses, whose worlds have any axes.

Each recording is read in its own world, and in one that is turned and shifted at random, without a word about gravity.
The height of every camera above the floor of the panorama is compared with the truth: the floor of 7-Scenes is known to
3 cm, that of the cabinet to 1 cm, the others exactly.

Nothing was chosen on these recordings: the tests of a floor are those of a single view, errors of poses are published.

Source: ours.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from perception.primitives.frame import Frame
from perception.primitives.pose import Pose3

from ...config.schema import Config
from ...offline.panorama_views import gather
from ...progress import Say, silent
from ...recordings.open import open_recording
from ...recordings.recording import Recording, RecordingInfo, SkippedFrame
from ..support import real_data
from .replica_room import ReplicaRoom

REPLICA_EVERY = 100  # frames of the simulated recording
TURNED = Pose3.from_rotation(
    Rotation.random(random_state=1).as_matrix(), np.array([30.0, -50.0, 12.0])
)


class InWorld(Recording):
    """Frames whose poses are given in turned and shifted axes, without gravity."""

    def __init__(self, name: str, frames: list[Frame], T_new_world: Pose3) -> None:
        self._info = RecordingInfo(name, "plain", poses_given=True)
        self._frames = frames
        self._T_new_world = T_new_world

    @property
    def info(self) -> RecordingInfo:
        """Name, and that poses are given."""
        return self._info

    @property
    def skipped(self) -> list[SkippedFrame]:
        """None."""
        return []

    @property
    def remarks(self) -> list[str]:
        """None."""
        return []

    def frames(self) -> Iterator[Frame]:
        """The frames with turned poses."""
        for frame in self._frames:
            assert frame.T_world_camera is not None, "every frame has a pose"
            yield replace(frame, T_world_camera=self._T_new_world @ frame.T_world_camera)


def run(say: Say) -> tuple[dict[str, float], list[str]]:
    """Heights of all cameras in five recordings, ten seconds."""
    kitchen = real_data.folder("sevenscenes_redkitchen")
    figures: dict[str, float] = {}
    table = []
    for name, read in {
        "kitchen sweep": lambda: _kitchen(kitchen, "sweep"),
        "kitchen pan": lambda: _kitchen(kitchen, "pan"),
        "cabinet": _cabinet,
        "living room": _living_room,
        "office, simulated": _office,
    }.items():
        frames, heights = read()
        errors = {
            where: height_errors_m(InWorld(name, frames, T), heights)
            for where, T in (("as recorded", Pose3()), ("turned", TURNED))
        }
        worst = max(float(np.abs(error).max()) for error in errors.values())
        figure = "camera_height_error_max_m" if "kitchen" in name else "other_height_error_max_m"
        figures[figure] = max(figures.get(figure, 0.0), worst)
        medians = ", ".join(
            f"{where} {1e3 * np.median(error):+.0f} (worst {1e3 * np.abs(error).max():.0f})"
            for where, error in errors.items()
        )
        table.append(f"{name:<18} camera height error of {len(frames)} frames, mm: {medians}")
        say(table[-1])
    return figures, table


def height_errors_m(
    recording: Recording, heights_m: Float[np.ndarray, "n"]
) -> Float[np.ndarray, "n"]:
    """Height of each camera above the floor of the panorama, minus the true one; infinite without a floor."""
    gathered = gather(recording, Config(), silent)
    if gathered.floor is None:
        return np.full(len(heights_m), np.inf)
    poses = [frame.T_world_camera for frame in recording.frames()]
    first, prior = poses[gathered.frames[0]], gathered.views[0].prior
    assert first is not None, "every frame has a pose"
    assert prior is not None, "views by poses have priors"
    T_base_world = prior @ first.inverse()
    found = [T_base_world.apply(pose.position)[2] for pose in poses if pose is not None]
    return np.array(found) - heights_m


def _kitchen(folder: Path, part: str) -> tuple[list[Frame], np.ndarray]:
    frames = list(open_recording(folder / part).frames())
    return frames, np.array([floor.offset_m for floor in real_data.kitchen_floors(part)])


def _cabinet() -> tuple[list[Frame], np.ndarray]:
    """World z = 0 is the floor."""
    return _with_heights("tum_fr3_cabinet", lambda position: float(position[2]))


def _living_room() -> tuple[list[Frame], np.ndarray]:
    return _with_heights(
        "redwood_livingroom", lambda place: float(place[1]) - real_data.REDWOOD_FLOOR_M
    )


def _with_heights(
    name: str, height: Callable[[np.ndarray], float]
) -> tuple[list[Frame], np.ndarray]:
    frames = list(open_recording(real_data.folder(name)).frames())
    return frames, _heights(frames, height)


def _office() -> tuple[list[Frame], np.ndarray]:
    room = ReplicaRoom(real_data.folder("replica_office0"))
    frames = list(room.frames(np.random.default_rng(0), REPLICA_EVERY))
    return frames, _heights(frames, lambda place: float(place[2]) - real_data.REPLICA_FLOOR_M)


def _heights(frames: list[Frame], height: Callable[[np.ndarray], float]) -> np.ndarray:
    poses = [frame.T_world_camera for frame in frames]
    return np.array([height(pose.position) for pose in poses if pose is not None])
