"""Roll, pitch and sensor biases from the gyro and accelerometer of a real IMU.

A fixed rotation first aligns the z axis with the initial vertical, so that roll and pitch stay away from their
singularity. The accelerometer measures the vertical while the body does not accelerate; its noise increases with the
deviation of its magnitude from gravity and with vibration.

Truth: at rest the floor normal in the camera, in flight two poses by motion capture.

Source: ours; data set EuRoC V1_01.
"""

from __future__ import annotations

import csv
import gzip
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from perception.filtering.square_root import SquareRootFilter
from perception.primitives.errors import RecordingError
from perception.primitives.gaussian import Gaussian

from ..support import real_data

GRAVITY = 9.81
REST_S = 3.0  # initial period at rest on the floor
EVERY = 4  # IMU samples averaged: 50 Hz
GYRO_SIGMA = 0.002  # rad/s per sample of 50 Hz: ADIS16448, its density times the root of the rate
GYRO_WALK = 2e-5  # rad/s per root of a second: data sheet of the recording
FORCE_SIGMA = 0.05  # m/s^2 at rest, 50 Hz, motors on
FORCE_WALK = 3e-3  # m/s^2 per root of a second: data sheet of the recording
SHAKE_SIGMA = 0.05  # rad/s, of a body at rest with its motors on
START_SIGMA = np.array([0.05, 0.05, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1])  # rad, rad/s, m/s^2
MEMORY_S = 1.0  # time constant of the vibration level


@dataclass(frozen=True)
class TiltOutcome:
    """Errors of the vertical, and the biases at the end of the rest.

    Args:
        rest_deg: Error against the floor normal at the end of the rest.
        flight_deg: Largest error against motion capture in flight.
        gyro_bias: Gyro bias, IMU axes, rad/s.
        force_bias: Accelerometer bias, IMU axes, m/s^2.
    """

    rest_deg: float
    flight_deg: float
    gyro_bias: Float[np.ndarray, "3"]
    force_bias: Float[np.ndarray, "3"]


class TiltFilter:
    """Square-root filter for roll, pitch, and the biases of gyro and accelerometer."""

    def __init__(self, force: Float[np.ndarray, "3"]) -> None:
        """Start with the vertical given by a mean specific force."""
        up = force / np.linalg.norm(force)
        side = np.cross(up, [0.0, 0.0, 1.0] if abs(up[2]) < 0.9 else [1.0, 0.0, 0.0])
        side /= np.linalg.norm(side)
        self._level = np.stack(
            [side, np.cross(up, side), up]
        )  # rotation from IMU axes to level axes
        self._filter = SquareRootFilter(
            Gaussian(np.zeros(8), np.diag(START_SIGMA**2)), angles=(0, 1)
        )
        self._unrest = 0.0

    @property
    def up(self) -> Float[np.ndarray, "3"]:
        """Unit vector upwards, IMU axes."""
        roll, pitch = self._filter.mean[:2]
        return np.asarray(self._level.T @ _up(np.array([[roll, pitch]]))[0])

    @property
    def biases(self) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
        """Biases of the gyro, rad/s, and of the accelerometer, m/s^2, IMU axes."""
        mean = self._filter.mean
        return self._level.T @ mean[2:5], self._level.T @ mean[5:8]

    def advance(
        self,
        rate: Float[np.ndarray, "3"],
        force: Float[np.ndarray, "3"],
        dt: float,
        rests: bool = False,
    ) -> None:
        """Process the means of angular rate, rad/s, and specific force, m/s^2, over dt seconds.

        With `rests`, the body is known to be at rest, so that the gyro measures its own bias.
        """
        rate, force = self._level @ rate, self._level @ force

        def turn(points: np.ndarray) -> np.ndarray:
            moved = points.copy()
            w = rate - points[:, 2:5]
            s, c, t = np.sin(points[:, 0]), np.cos(points[:, 0]), np.tan(points[:, 1])
            moved[:, 0] += dt * (w[:, 0] + t * (s * w[:, 1] + c * w[:, 2]))
            moved[:, 1] += dt * (c * w[:, 1] - s * w[:, 2])
            return moved

        angle, gyro, accelerometer = GYRO_SIGMA * dt, GYRO_WALK * dt**0.5, FORCE_WALK * dt**0.5
        sigma = np.array([angle] * 2 + [gyro] * 3 + [accelerometer] * 3)
        self._filter.predict(turn, np.diag(sigma**2))
        keep = math.exp(-dt / MEMORY_S)
        moving = abs(float(np.linalg.norm(force)) - GRAVITY)
        self._unrest = math.sqrt(keep * self._unrest**2 + (1.0 - keep) * moving**2)
        sigma_force = (
            FORCE_SIGMA + 3.0 * max(self._unrest - 0.1, 0.0) + 3.0 * max(moving - 0.1, 0.0)
        )
        self._filter.update(
            lambda points: GRAVITY * _up(points) + points[:, 5:8], force, sigma_force**2 * np.eye(3)
        )
        if rests:
            self._filter.update(lambda points: points[:, 2:5], rate, SHAKE_SIGMA**2 * np.eye(3))


def _up(points: Float[np.ndarray, "k n"]) -> Float[np.ndarray, "k 3"]:
    """Vertical in level axes after a rotation by roll and pitch, the first two state entries."""
    roll, pitch = points[:, 0], points[:, 1]
    return np.stack(
        [-np.sin(pitch), np.sin(roll) * np.cos(pitch), np.cos(roll) * np.cos(pitch)], axis=-1
    )


def read_imu(path: Path) -> Float[np.ndarray, "n 7"]:
    """Stamp (s since the first), angular rate, rad/s, and specific force, m/s^2, of a EuRoC file."""
    try:
        table = np.loadtxt(path, delimiter=",")
    except (OSError, ValueError) as error:
        raise RecordingError(f"{path}: {error}; expected seven numbers per line") from error
    table[:, 0] = (table[:, 0] - table[0, 0]) * 1e-9
    return np.asarray(table)


def tilt(folder: Path) -> TiltOutcome:
    """Process a EuRoC recording, at rest and in flight."""
    path = folder / "imu0.csv.gz"
    with gzip.open(path, "rt", encoding="utf-8") as file:
        first_ns = int(next(line for line in file if not line.startswith("#")).split(",")[0])
    samples = read_imu(path)
    count = len(samples) // EVERY
    means = samples[: count * EVERY].reshape(count, EVERY, 7).mean(axis=1)
    tilt_filter = TiltFilter(means[:10, 4:7].mean(axis=0))
    checks = _vicon_up(folder, first_ns)
    dt = EVERY * float(np.median(np.diff(samples[:, 0])))
    rest_deg, flight = math.nan, []
    gyro_bias = force_bias = np.full(3, math.nan)
    for stamp, *values in means.tolist():
        tilt_filter.advance(np.array(values[:3]), np.array(values[3:]), dt, rests=stamp < REST_S)
        if math.isnan(rest_deg) and stamp >= REST_S:
            rest_deg = _angle_deg(tilt_filter.up, _floor_up(folder))
            gyro_bias, force_bias = tilt_filter.biases
        while checks and stamp >= checks[0][0]:
            flight.append(_angle_deg(tilt_filter.up, checks.pop(0)[1]))
    return TiltOutcome(rest_deg, max(flight), gyro_bias, force_bias)


def _floor_up(folder: Path) -> Float[np.ndarray, "3"]:
    """Floor normal at rest, IMU axes."""
    floors = real_data.floors(folder / "floor.csv")
    names = {path.stem for path in (folder / "static" / "cam0").glob("*.png")}
    normal = np.mean([plane.normal for name, plane in floors.items() if name in names], axis=0)
    text = (folder / "cam0.yaml").read_text(encoding="utf-8")
    numbers = text.split("data: [")[1].split("]")[0].split(",")
    T_imu_camera = np.array([float(number) for number in numbers]).reshape(4, 4)
    return np.asarray(T_imu_camera[:3, :3] @ normal)


def _vicon_up(folder: Path, first_ns: int) -> list[tuple[float, np.ndarray]]:
    """Stamps, s, and vertical in IMU axes, where motion capture gives the attitude."""
    with (folder / "room_groundtruth.csv").open(encoding="utf-8") as file:
        rows = list(csv.reader(line for line in file if not line.startswith("#")))
    found = []
    for row in rows:
        w, x, y, z = (float(v) for v in row[4:8])
        R_world_imu = Rotation.from_quat([x, y, z, w]).as_matrix()
        found.append(((int(row[0]) - first_ns) * 1e-9, R_world_imu[2]))
    return sorted(found, key=lambda pair: pair[0])


def _angle_deg(a: np.ndarray, b: np.ndarray) -> float:
    cosine = float(a @ b / (np.linalg.norm(a) * np.linalg.norm(b)))
    return math.degrees(math.acos(min(1.0, max(-1.0, cosine))))
