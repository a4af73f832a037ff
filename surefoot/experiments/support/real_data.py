"""Where the real recordings are, and the floors that are known for them."""

from __future__ import annotations

import csv
import os
from pathlib import Path

import numpy as np

from perception.primitives.errors import InputError
from perception.primitives.plane import Plane


def folder(name: str) -> Path:
    """Folder of one real recording, below SUREFOOT_DATA (default ../shared/data).

    Raises:
        InputError: It is not there.
    """
    root = Path(os.environ.get("SUREFOOT_DATA", "../shared/data"))
    if not (root / name).exists():
        raise InputError(
            f"real recording {name!r} not found in {root.resolve()}; "
            "set SUREFOOT_DATA to the folder that holds it"
        )
    return root / name


def floors(path: Path) -> dict[str, Plane]:
    """The known floors of a recording, by frame name, in the camera frame.

    The covariance is what the file itself claims: sigma_deg for both tilts, sigma_m for the height.
    """
    with path.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    planes = {}
    for row in rows:
        normal = np.array([float(row[axis]) for axis in ("nx", "ny", "nz")])
        tilt, height = np.radians(float(row["sigma_deg"])), float(row["sigma_m"])
        planes[row["frame"]] = Plane(
            normal / np.linalg.norm(normal),
            float(row["height_m"]),
            np.diag([tilt**2, tilt**2, height**2]),
        )
    return planes
