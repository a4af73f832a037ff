"""Location of the real recordings, and their reference floor planes and cameras."""

from __future__ import annotations

import csv
import os
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Integer

from perception.primitives.camera import Camera
from perception.primitives.errors import InputError
from perception.primitives.frame import DepthView
from perception.primitives.plane import Plane

REPLICA_FLOOR_M, REDWOOD_FLOOR_M = -1.135, 0.13
"""Floor in the worlds of replica_office0 (z, shown by its mesh to a centimetre) and redwood_livingroom (y, exact)."""
LOW_BOXES_HEIGHTS_M = (0.568, 0.176, 0.159, 0.214, 0.214, 0.071)
"""Camera above the floor in each frame of realsense_low_boxes: planes fitted, by the description of the set."""
KINECT2 = Camera(730, 530, 529.5, 529.5, 364.0, 264.0)
"""Camera of the set sunrgbd_kinect2, by its own calibration."""
KINECT2_PER_M = 5000.0


def folder(name: str) -> Path:
    """Folder of one real recording below SUREFOOT_DATA (default ../shared/data).

    Raises:
        InputError: The folder does not exist.
    """
    root = Path(os.environ.get("SUREFOOT_DATA", "../shared/data"))
    if not (root / name).exists():
        raise InputError(
            f"real recording {name!r} not found in {root.resolve()}; "
            "set SUREFOOT_DATA to the folder that holds it"
        )
    return root / name


def kinect2_view(name: str) -> DepthView:
    """Depth image of one view of sunrgbd_kinect2.

    Raises:
        InputError: The image cannot be read.
    """
    return depth_view(folder("sunrgbd_kinect2") / f"{name}.depth.png", KINECT2_PER_M, KINECT2)


def depth_view(path: Path, per_m: float, camera: Camera) -> DepthView:
    """A depth image of 16 bits in which 0 means no depth.

    Raises:
        InputError: The image cannot be read.
    """
    raw = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if raw is None:
        raise InputError(f"image {path} cannot be read; is the data set complete?")
    return DepthView(np.where(raw == 0, np.nan, raw / per_m).astype(np.float32), camera)


def grey(path: Path) -> Integer[np.ndarray, "h w"]:
    """An image in grey levels, converted from colour by OpenCV's weights.

    Raises:
        InputError: The image cannot be read.
    """
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if image is None:
        raise InputError(f"image {path} cannot be read; is the data set complete?")
    return np.asarray(image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY))


def kitchen_floors(part: str) -> list[Plane]:
    """Reference floor of every frame of sevenscenes_redkitchen, "sweep" or "pan", in order, camera frame."""
    known = floors(folder("sevenscenes_redkitchen") / "floor.csv")
    return [known[name] for name in kitchen_names(part)]


def kitchen_names(part: str) -> list[str]:
    """Number of every frame of a part of sevenscenes_redkitchen, as its files have it."""
    place = folder("sevenscenes_redkitchen") / part
    return sorted(path.name[6:12] for path in place.glob("frame-*.depth.png"))


def floors(path: Path) -> dict[str, Plane]:
    """Reference floor planes of a recording by frame name, camera frame.

    The covariance is that of the file: sigma_deg for both tilts, sigma_m for the height.
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
