"""ICL-NUIM folders (the TUM-compatible PNGs): rendered rooms with exact trajectories.

`associations.txt` pairs `depth/K.png` and `rgb/K.png`; `*.gt.freiburg` or `groundtruth.txt` has the poses, one line
per frame. The data set is rendered in left-handed axes with y up, which its calibration expresses by a negative fy.
This reader flips the y axes of camera and world, which makes both right-handed: the images stay the same, fy is
positive, and -y is up in the world.

Source: Handa et al., ICRA 2014; www.doc.ic.ac.uk/~ahanda/VaFRIC/iclnuim.html.
"""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path

from perception.primitives import safe_input
from perception.primitives.camera import Camera
from perception.primitives.errors import RecordingError
from perception.primitives.pose import Pose3

from .description import Description, known_layout
from .folder import KINECT_HZ, FolderRecording, FrameFiles
from .images import DepthUnit
from .poses import mirrored, pose_of_row, read_lines, read_tum
from .recording import RecordingInfo

UNIT = DepthUnit(5000.0, (0,))
CAMERA = Camera(640, 480, 481.2, 480.0, 319.5, 239.5)
"""From the data set's page, with positive fy."""

_LIST = "associations.txt"


def is_icl_nuim(path: Path) -> bool:
    """Whether the folder has the list of pairs, which begins with an integer and not with a time."""
    if not (path / _LIST).is_file() or not (path / "depth").is_dir():
        return False
    try:
        first = read_lines(path / _LIST)[0][1]
    except RecordingError:
        return False
    return safe_input.whole(first[0]) is not None


def open_icl_nuim(path: Path, description: Description | None = None) -> FolderRecording:
    """Open a folder of the data set.

    Raises:
        RecordingError: The list or the trajectory cannot be parsed.
    """
    remarks: list[str] = []
    truth = _trajectory(path)
    rows = {} if truth is None else _rows(truth)
    files = []
    for line, words in read_lines(path / _LIST):
        number = safe_input.whole(words[0])
        if len(words) != 4 or number is None:
            raise RecordingError(
                f"{path / _LIST}, line {line}: {' '.join(words)!r}; expected: number depth/K.png number "
                "rgb/K.png"
            )
        row = rows.get(number)
        files.append(
            FrameFiles(
                words[1],
                number / KINECT_HZ,
                path / words[1],
                path / words[3],
                None if row is None else partial(_flipped, row),
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
        calibrated=True,
    )
    return known_layout(path, info, files, camera, UNIT, remarks, description)


def _trajectory(path: Path) -> Path | None:
    """The trajectory file, in the folder or next to it."""
    found = [
        *sorted(path.glob("*.gt.freiburg")),
        *sorted(path.parent.glob(f"{path.name}*.gt.freiburg")),
    ]
    found += [file for file in (path / "groundtruth.txt",) if file.is_file()]
    return found[0] if found else None


def _rows(truth: Path) -> dict[int, tuple[float, ...]]:
    """Poses by the number of the frame, which is the stamp in this data set; none where it is not finite."""
    stamps, rows = read_tum(truth)
    lines = zip(stamps.tolist(), rows, strict=True)
    return {round(stamp): row for stamp, row in lines if math.isfinite(stamp)}


def _flipped(row: tuple[float, ...]) -> Pose3:
    return mirrored(pose_of_row(row))
