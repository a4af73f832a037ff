"""ICL-NUIM folders (the TUM-compatible PNGs): rendered rooms with exact trajectories.

`depth/K.png` and `rgb/K.png` are joined by `associations.txt`; `*.gt.freiburg` or `groundtruth.txt` has the poses, one
line a frame. The set is rendered with y up, left-handed, which its calibration writes as a negative fy.
Here the y axes of camera and world are turned over, which makes both right-handed: the same picture, fy
positive, and the world's up is -y.

Source: Handa et al., ICRA 2014; www.doc.ic.ac.uk/~ahanda/VaFRIC/iclnuim.html.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np

from perception.primitives.camera import Camera
from perception.primitives.errors import RecordingError
from perception.primitives.pose import Pose3

from .description import Description, complete
from .folder import KINECT_HZ, FolderRecording, FrameFiles
from .images import DepthUnit
from .poses import pose_of_row, read_lines, read_tum
from .recording import RecordingInfo

UNIT = DepthUnit(5000.0, (0,))
CAMERA = Camera(640, 480, 481.2, 480.0, 319.5, 239.5)
"""By the set's page, with the sign of fy turned over."""

_LIST = "associations.txt"
_OVER = np.diag([1.0, -1.0, 1.0])


def is_icl_nuim(path: Path) -> bool:
    """Whether the folder has the set's list of pairs, which begins with a whole number and not a time."""
    if not (path / _LIST).is_file() or not (path / "depth").is_dir():
        return False
    try:
        first = read_lines(path / _LIST)[0][1]
    except RecordingError:
        return False
    return first[0].isdigit()


def open_icl_nuim(path: Path, description: Description | None = None) -> FolderRecording:
    """Open a folder of the set.

    Raises:
        RecordingError: for a list that cannot be parsed, or a trajectory shorter than the list.
    """
    remarks: list[str] = []
    truth = _trajectory(path)
    rows = {} if truth is None else _rows(truth)
    files = []
    for line, words in read_lines(path / _LIST):
        if len(words) != 4 or not words[0].isdigit():
            raise RecordingError(
                f"{path / _LIST}, line {line}: {' '.join(words)!r}; expected: number depth/K.png number "
                "rgb/K.png"
            )
        number = int(words[0])
        row = rows.get(number)
        files.append(
            FrameFiles(
                words[1],
                number / KINECT_HZ,
                path / words[1],
                path / words[3],
                None if row is None else partial(_turned_over, row),
            )
        )
    without = sum(frame.pose is None for frame in files)
    if truth is not None and without:
        remarks.append(f"{without} of {len(files)} frames have no line in {truth.name}")
    camera = CAMERA
    if description is not None and description.camera is not None:
        camera = description.camera
    info = RecordingInfo(
        name=path.resolve().name,
        kind="icl_nuim",
        poses_given=without < len(files),
        frames=len(files),
        gravity_up_world=(0.0, -1.0, 0.0),
    )
    return FolderRecording(path, complete(info, description), files, camera, UNIT, remarks=remarks)


def _trajectory(path: Path) -> Path | None:
    """The set's own file, beside or in the folder."""
    found = [
        *sorted(path.glob("*.gt.freiburg")),
        *sorted(path.parent.glob(f"{path.name}*.gt.freiburg")),
    ]
    found += [file for file in (path / "groundtruth.txt",) if file.is_file()]
    return found[0] if found else None


def _rows(truth: Path) -> dict[int, tuple[float, ...]]:
    """By the number of the frame, which is the set's stamp."""
    stamps, rows = read_tum(truth)
    return {round(float(stamp)): row for stamp, row in zip(stamps, rows, strict=True)}


def _turned_over(row: tuple[float, ...]) -> Pose3:
    pose = pose_of_row(row)
    return Pose3.from_rotation(_OVER @ pose.rotation @ _OVER, _OVER @ pose.position)
