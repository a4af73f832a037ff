"""EuRoC folders: raw grey pairs `cam0/data/T.png` and `cam1/data/T.png`, calibrations, IMU, poses.

T is the stamp in nanoseconds. The images may also be in `cam0/` itself. Calibrations, IMU data and poses may be
beside the camera folders or one folder up: `cam0/sensor.yaml` or `cam0.yaml`; `imu0/data.csv`, `imu0.csv` or
`imu0.csv.gz`; `state_groundtruth_estimate0/data.csv` or `NAME_groundtruth.csv` for the folder NAME.

The reader rectifies the pairs; every pose is that of the rectified left camera. Inertial measurements are rotated
to the body axes of that camera: x along the optical axis, y left, z up in the image.

Source: Burri et al., IJRR 2016 (file formats).
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from jaxtyping import Float

from perception.depth.rectification import Rectification, rectification
from perception.primitives import safe_input
from perception.primitives.errors import InputError, RecordingError
from perception.primitives.frame import Frame, Imu, StereoView
from perception.primitives.pose import CAMERA_IN_BODY_AXES, Pose3
from perception.primitives.safe_input import UnreadableError

from .description import Description, complete
from .folder import pictures
from .poses import pose_of_row, poses_at
from .recording import RecordingInfo
from .stereo_calibration import RawCamera, read_euroc_camera, read_extrinsics
from .stereo_pairs import StereoRecording

FIRST_S = 0.05  # ours: the first frame uses the samples within this time around it
MAX_MEAN_S = 1.0  # ours: longest interval before a frame whose samples are averaged
_NS = 1e-9
_STAMP = re.compile(r"[0-9]{1,19}")  # ns; 64 bits hold them


def is_euroc(path: Path) -> bool:
    """Whether the folder has the layout."""
    return all(_pictures(path, name) and _beside(path, _calibrations(name)) for name in _CAMERAS)


def open_euroc(path: Path, description: Description | None = None) -> EurocRecording:
    """Open one sequence (its `mav0` folder, if there is one).

    Raises:
        RecordingError: A calibration, the IMU file or the poses cannot be read.
    """
    raw = [read_euroc_camera(_expected(path, _calibrations(name))) for name in _CAMERAS]
    left, right = raw
    try:
        rig = rectification(
            left.camera, right.camera, left.T_body_camera.inverse() @ right.T_body_camera
        )
    except InputError as error:
        raise RecordingError(f"{path}: {error}") from error
    files = _pairs(path)
    remarks = []
    poses = _table(_beside(path, _pose_files(path)), 8)
    samples = _table(_beside(path, _INERTIAL), 7)
    if samples is None:
        remarks.append("no imu0 file: frames have no inertial measurements")
    info = RecordingInfo(
        name=path.resolve().name,
        kind="euroc",
        poses_given=poses is not None,
        frames=len(files),
        gravity_up_world=(0.0, 0.0, 1.0) if poses is not None else None,
    )
    if description is not None and description.camera is not None:
        raise RecordingError(
            f"{description.path}: [camera] is defined by cam0.yaml and cam1.yaml; leave it out"
        )
    unmatched = len(_pictures(path, "cam0")) - len(files)
    if unmatched:
        remarks.append(f"{unmatched} left images have no right image with the same stamp")
    imu_yaml = _beside(path, ("imu0/sensor.yaml", "imu0.yaml"))
    T_body_imu = Pose3() if imu_yaml is None else read_extrinsics(imu_yaml)
    return EurocRecording(path, complete(info, description), files, left, rig, remarks).with_tables(
        poses, samples, T_body_imu
    )


class EurocRecording(StereoRecording):
    """Stereo pairs, rectified by the reader, optionally with inertial measurements and poses.

    Args:
        path: Folder, for messages.
        info: Information about the recording.
        files: Stamp, ns, left and right image of every pair, in order of time.
        left: The raw left camera.
        rig: Rectification of the pairs.
        remarks: Remarks for the user.

    Raises:
        RecordingError: There is no pair.
    """

    SOURCE = "names of the images of EuRoC are read as ns"

    def __init__(
        self,
        path: Path,
        info: RecordingInfo,
        files: list[tuple[int, Path, Path]],
        left: RawCamera,
        rig: Rectification,
        remarks: list[str],
    ) -> None:
        self._stamps = [stamp for stamp, _, _ in files]
        pairs = [(_NS * stamp, a, b) for stamp, a, b in files]
        super().__init__(path, info, pairs, left.camera, rig.apply, remarks)
        self.rig = rig
        self.T_body_rectified = left.T_body_camera @ rig.T_left_rectified
        self._poses: np.ndarray | None = None
        self._samples: np.ndarray | None = None
        self._turn_imu = np.eye(3)

    def with_tables(
        self,
        poses: Float[np.ndarray, "n k"] | None,
        samples: Float[np.ndarray, "m j"] | None,
        T_body_imu: Pose3,
    ) -> EurocRecording:
        """Add poses of the body (ns, m, quaternion w x y z) and IMU samples (ns, rad/s, m/s^2)."""
        self._poses, self._samples = poses, samples
        T_camera_imu = self.T_body_rectified.inverse() @ T_body_imu
        self._turn_imu = CAMERA_IN_BODY_AXES @ T_camera_imu.rotation
        return self

    def _frame(self, number: int, before: int | None, view: StereoView) -> Frame:
        stamp = self._stamps[number]
        return Frame(
            self._files[number][0],
            stereo=view,
            imu=self._inertial(None if before is None else self._stamps[before], stamp),
            T_world_camera=self._pose(stamp),
        )

    def _pose(self, stamp: int) -> Pose3 | None:
        """Pose of the rectified left camera in the world; None without a body pose within 20 ms."""
        if self._poses is None:
            return None
        since_s = (self._poses[:, 0] - stamp) * _NS
        (pose,) = poses_at(np.zeros(1), since_s, self._body)
        return None if pose is None else pose() @ self.T_body_rectified

    def _body(self, row: int) -> Pose3:
        assert self._poses is not None
        x, y, z, qw, qx, qy, qz = (float(v) for v in self._poses[row, 1:8])
        return pose_of_row((x, y, z, qx, qy, qz, qw))

    def _inertial(self, before: int | None, stamp: int) -> Imu | None:
        """Mean over the time since the previous frame."""
        if self._samples is None:
            return None
        times = self._samples[:, 0]
        if before is None:
            wanted = np.abs(times - stamp) * _NS <= FIRST_S
        else:
            wanted = (times > max(before, stamp - MAX_MEAN_S / _NS)) & (times <= stamp)
        if not wanted.any():
            return None
        mean = self._samples[wanted, 1:7].mean(axis=0)
        return Imu(self._turn_imu @ mean[:3], self._turn_imu @ mean[3:])


_CAMERAS = ("cam0", "cam1")
_INERTIAL = ("imu0/data.csv", "imu0.csv", "imu0.csv.gz", "imu0/data.csv.gz")


def _calibrations(camera: str) -> tuple[str, ...]:
    return (f"{camera}/sensor.yaml", f"{camera}.yaml")


def _pose_files(path: Path) -> tuple[str, ...]:
    return ("state_groundtruth_estimate0/data.csv", f"{path.resolve().name}_groundtruth.csv")


def _beside(path: Path, names: tuple[str, ...]) -> Path | None:
    """The first of these files in the folder or one folder up."""
    places = [place / name for place in (path, path.resolve().parent) for name in names]
    return next((place for place in places if place.is_file()), None)


def _expected(path: Path, names: tuple[str, ...]) -> Path:
    found = _beside(path, names)
    if found is None:
        raise RecordingError(f"{path}: no {' or '.join(names)} here or one folder up")
    return found


def _pictures(path: Path, camera: str) -> list[Path]:
    return pictures(path / camera / "data") or pictures(path / camera)


def _pairs(path: Path) -> list[tuple[int, Path, Path]]:
    """Stamp, ns, and both images of every stamp that both cameras have; other names are ignored."""
    left, right = (
        {int(p.stem): p for p in _pictures(path, name) if _STAMP.fullmatch(p.stem)}
        for name in _CAMERAS
    )
    return [(stamp, left[stamp], right[stamp]) for stamp in sorted(left) if stamp in right]


def _table(path: Path | None, columns: int) -> Float[np.ndarray, "n k"] | None:
    """Numbers of a comma-separated file with at least `columns` columns; the first is a stamp, ns."""
    if path is None:
        return None
    try:
        table = safe_input.table(path, ",")
    except UnreadableError as error:
        raise RecordingError(
            f"{path}: {error}; {columns} numbers per line, separated by commas, were expected"
        ) from error
    if table.shape[1] < columns:
        raise RecordingError(
            f"{path}: {table.shape[1]} numbers per line; at least {columns} were expected"
        )
    return np.asarray(table[np.isfinite(table[:, :columns]).all(axis=1)])
