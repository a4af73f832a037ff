"""Calibration files of stereo rigs: EuRoC (raw cameras on a body), ROS, OpenCV and KITTI (a rectified pair).

Those of EuRoC and ROS are simple YAML: a key, and a list of numbers after it or after `data:` below it. Nothing
else is read.

Source: Burri et al., IJRR 2016; ROS camera_info (P of the right camera holds -f times the baseline); OpenCV,
stereoRectify (P1 and P2, likewise); Geiger et al., CVPR 2012 (P0 to P3, all relative to camera 0).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from perception.primitives import safe_input
from perception.primitives.camera import Camera
from perception.primitives.errors import RecordingError
from perception.primitives.frame import LEAST_BASELINE_M, MOST_BASELINE_M
from perception.primitives.pose import Pose3
from perception.primitives.safe_input import UnreadableError

from .folder import camera_of

_DISTORTIONS = ("radial-tangential", "radtan", "plumb_bob")
_ORTHOGONAL = 1e-3  # ours: with ten printed digits, rotations are orthogonal to 1e-9


@dataclass(frozen=True)
class RawCamera:
    """A camera with distortion, and its mounting.

    Args:
        camera: Raw intrinsics with distortion.
        T_body_camera: Pose on the body of the rig (EuRoC: T_BS, the body is the IMU).
    """

    camera: Camera
    T_body_camera: Pose3


def read_euroc_camera(path: Path) -> RawCamera:
    """Read `cam0.yaml` or `sensor.yaml` of a EuRoC camera.

    Raises:
        RecordingError: A key is missing or invalid, or the camera model or distortion is not supported.
    """
    text = _read(path)
    for key, known in (("camera_model", ("pinhole",)), ("distortion_model", _DISTORTIONS)):
        value = _word(text, key)
        if value is not None and value not in known:
            raise RecordingError(
                f"{path}: {key} is {value!r}; only {' or '.join(known)} can be rectified"
            )
    width, height = (int(v) for v in _numbers(path, text, "resolution", (2,)))
    fx, fy, cx, cy = _numbers(path, text, "intrinsics", (4,))
    lens = [float(v) for v in _numbers(path, text, "distortion_coefficients", (4, 5))]
    k1, k2, p1, p2, k3 = lens + [0.0] * (5 - len(lens))
    camera = camera_of(path, width, height, fx, fy, cx, cy, (k1, k2, p1, p2, k3))
    return RawCamera(camera, read_extrinsics(path))


def read_extrinsics(path: Path) -> Pose3:
    """Read the pose of a sensor on the body: T_BS of any EuRoC sensor file.

    Raises:
        RecordingError: T_BS is missing or not a rigid transform.
    """
    T = _numbers(path, _read(path), "T_BS", (16,)).reshape(4, 4)
    if not np.allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=_ORTHOGONAL):
        raise RecordingError(f"{path}: T_BS has no valid rotation; a rigid transform was expected")
    return Pose3.from_matrix(T)


def read_rectified_pair(left: Path, right: Path) -> tuple[Camera, float]:
    """Camera and baseline, m, of a rectified pair (`*_left.yaml` of rtabmap).

    Raises:
        RecordingError: A key is missing, the two do not match, or the baseline is not positive.
    """
    text = _read(left)
    P, Q = (
        _numbers(path, _read(path), "projection_matrix", (12,)).reshape(3, 4)
        for path in (left, right)
    )
    width, height = (_whole(left, text, key) for key in ("image_width", "image_height"))
    return _rectified(left, right, width, height, P, Q)


def has_opencv_pair(path: Path) -> bool:
    """Whether a file of OpenCV's FileStorage holds P1 and P2."""
    try:
        text = safe_input.text(path)
    except UnreadableError:
        return False
    return bool(re.search(r"^P1:|<P1\b", text, re.M) and re.search(r"^P2:|<P2\b", text, re.M))


def read_opencv_pair(path: Path, width: int, height: int) -> tuple[Camera, float]:
    """Camera and baseline, m, of a rectified pair: P1 and P2 of OpenCV's stereoRectify.

    Args:
        path: YAML or XML as OpenCV's FileStorage writes it.
        width, height: Of the images, which the file does not tell.

    Raises:
        RecordingError: A matrix is missing, the two do not match, or the baseline is not positive.
    """
    text = _read(path)
    P, Q = (_opencv_matrix(path, text, name) for name in ("P1", "P2"))
    return _rectified(path, path, width, height, P, Q)


def read_kitti_pair(
    path: Path, names: tuple[str, str], width: int, height: int
) -> tuple[Camera, float]:
    """Camera and baseline, m, of a rectified pair: two lines of the `calib.txt` of KITTI's odometry benchmark.

    Args:
        path: Lines of a name, a colon and 12 numbers.
        names: Of the left and of the right projection matrix, such as P0 and P1.
        width, height: Of the images, which the file does not tell.

    Raises:
        RecordingError: A matrix is missing, the two do not match, or the baseline is not positive.
    """
    text = re.sub(r"^(\w+):(.*)$", r"\1: [\2]", _read(path), flags=re.M)
    P, Q = (_numbers(path, text, name, (12,)).reshape(3, 4) for name in names)
    return _rectified(path, path, width, height, P, Q)


def _opencv_matrix(path: Path, text: str, name: str) -> Float[np.ndarray, "3 4"]:
    """A 3x4 matrix of a file of OpenCV's FileStorage."""
    xml = re.search(rf"<{name}\b[^>]*>(.*?)</{name}>", text, re.DOTALL)
    if xml is not None:
        data = re.search(r"<data>([^<]*)</data>", xml[1])
        text = f"{name}: [{data[1]}]\n" if data else ""
    return _numbers(path, text, name, (12,)).reshape(3, 4)


def _rectified(
    left: Path,
    right: Path,
    width: int,
    height: int,
    P: Float[np.ndarray, "3 4"],
    Q: Float[np.ndarray, "3 4"],
) -> tuple[Camera, float]:
    """Camera and baseline, m, by the projection matrices of both sides."""
    if not np.allclose(P[:2, :2], Q[:2, :2], rtol=1e-6) or not np.isclose(P[1, 2], Q[1, 2]):
        raise RecordingError(
            f"{right}: its projection matrix has other intrinsics than that of the left camera; those of "
            "a rectified pair are equal"
        )
    if not np.isclose(P[0, 2], Q[0, 2]):
        raise RecordingError(
            f"{right}: cx is {Q[0, 2]:.2f} px, that of the left camera {P[0, 2]:.2f} px; pairs whose "
            "disparity does not vanish at infinity are not read, rectify with CALIB_ZERO_DISPARITY"
        )
    baseline = float((P[0, 3] - Q[0, 3]) / Q[0, 0])
    if not LEAST_BASELINE_M <= baseline <= MOST_BASELINE_M:
        raise RecordingError(
            f"{right}: its projection matrix gives a baseline of {baseline:g} m; -f times a positive "
            f"baseline in m, below {MOST_BASELINE_M:g}, was expected in its fourth number; left and right "
            "may be exchanged, or the unit of the calibration board was not m"
        )
    return camera_of(left, width, height, P[0, 0], P[1, 1], P[0, 2], P[1, 2]), baseline


def _read(path: Path) -> str:
    try:
        text = safe_input.text(path)
    except UnreadableError as error:
        raise RecordingError(
            f"{path}: cannot be read ({error}); a YAML calibration file was expected"
        ) from error
    return "\n".join(line.split("#")[0] for line in text.splitlines()) + "\n"


def _numbers(path: Path, text: str, key: str, counts: tuple[int, ...]) -> Float[np.ndarray, "n"]:
    """The list after a key, or after the `data:` indented below it."""
    found = re.search(
        rf"^{key}:[ \t]*(?:!!\S+)?\s*(?:\n(?:[ \t]+\w+:.*\n)*?[ \t]+data:\s*)?\[([^\]]*)\]",
        text,
        re.M,
    )
    expected = " or ".join(str(count) for count in counts)
    if found is None:
        raise RecordingError(f"{path}: has no list {key}; {expected} numbers were expected")
    words = found[1].replace(",", " ").split()
    try:
        values = np.array([float(word) for word in words])
    except ValueError as error:
        raise RecordingError(f"{path}: {key} has a word that is not a number ({error})") from error
    if len(values) not in counts or not np.isfinite(values).all():
        raise RecordingError(
            f"{path}: {key} has {len(values)} numbers; {expected} finite ones were expected"
        )
    return values


def _whole(path: Path, text: str, key: str) -> int:
    value = _word(text, key)
    found = None if value is None else safe_input.whole(value)
    if found is None:
        raise RecordingError(f"{path}: {key} is {value}; a number of pixels was expected")
    return found


def _word(text: str, key: str) -> str | None:
    found = re.search(rf"^{key}:[ \t]*(\S+)", text, re.M)
    return None if found is None else found[1].strip("\"'")
