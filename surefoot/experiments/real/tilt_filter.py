"""Which way is up: gyro and accelerometer of a real IMU, with the biases of both estimated.

The instrument is first turned by a fixed rotation so that its z axis starts upwards; roll and pitch then stay far from
where they are not defined. The accelerometer tells where up is when the body does not accelerate; the more
its size differs from gravity, and the more it shakes, the less it is believed.

Attitude truth: at rest the floor's normal in the camera, in flight two poses by motion capture.
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
REST_S = 3.0  # the instrument stands on the floor for so long
EVERY = 4  # IMU samples taken together: 50 Hz
GYRO_SIGMA = 0.002  # rad/s per sample of 50 Hz: ADIS16448, its density times the root of the rate
GYRO_WALK = 2e-5  # rad/s per root of a second: data sheet of the recording
FORCE_SIGMA = 0.05  # m/s^2 at rest, 50 Hz, motors on
FORCE_WALK = 3e-3  # m/s^2 per root of a second: data sheet of the recording
SHAKE_SIGMA = 0.05  # rad/s, turn rate of a body that rests with its motors on
START_SIGMA = np.array([0.05, 0.05, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1])  # rad, rad/s, m/s^2
MEMORY_S = 1.0  # s over which shaking is judged


@dataclass(frozen=True)
class TiltOutcome:
    """Errors of the vertical, deg, and the biases at the end of the rest.

    Args:
        rest_deg: Against the floor's normal, after the rest.
        flight_deg: Against motion capture, worst instant in flight.
        gyro_bias: rad/s, axes of the instrument.
        force_bias: m/s^2, likewise.
    """

    rest_deg: float
    flight_deg: float
    gyro_bias: Float[np.ndarray, "3"]
    force_bias: Float[np.ndarray, "3"]


class TiltFilter:
    """Roll and pitch, biases of gyro and accelerometer; axes of the instrument."""

    def __init__(self, force: Float[np.ndarray, "3"]) -> None:
        """Begin with a first guess of up: the mean specific force of a moment."""
        up = force / np.linalg.norm(force)
        side = np.cross(up, [0.0, 0.0, 1.0] if abs(up[2]) < 0.9 else [1.0, 0.0, 0.0])
        side /= np.linalg.norm(side)
        self._level = np.stack(
            [side, np.cross(up, side), up]
        )  # level axes from those of the instrument
        self._filter = SquareRootFilter(
            Gaussian(np.zeros(8), np.diag(START_SIGMA**2)), angles=(0, 1)
        )
        self._unrest = 0.0

    @property
    def up(self) -> Float[np.ndarray, "3"]:
        """Unit vector upwards, axes of the instrument."""
        roll, pitch = self._filter.mean[:2]
        return np.asarray(self._level.T @ _up(np.array([[roll, pitch]]))[0])

    @property
    def biases(self) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
        """Of the gyro, rad/s, and of the accelerometer, m/s^2, axes of the instrument."""
        mean = self._filter.mean
        return self._level.T @ mean[2:5], self._level.T @ mean[5:8]

    def advance(
        self,
        rate: Float[np.ndarray, "3"],
        force: Float[np.ndarray, "3"],
        dt: float,
        rests: bool = False,
    ) -> None:
        """Learn from the means of turn rate, rad/s, and specific force, m/s^2, over dt seconds.

        Whoever knows that the body rests says so: then the gyro tells its own bias.
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
        shaken = FORCE_SIGMA + 3.0 * max(self._unrest - 0.1, 0.0) + 3.0 * max(moving - 0.1, 0.0)
        self._filter.update(
            lambda points: GRAVITY * _up(points) + points[:, 5:8], force, shaken**2 * np.eye(3)
        )
        if rests:
            self._filter.update(lambda points: points[:, 2:5], rate, SHAKE_SIGMA**2 * np.eye(3))


def _up(points: Float[np.ndarray, "k n"]) -> Float[np.ndarray, "k 3"]:
    """Up in level axes turned by roll and pitch, the first two entries."""
    roll, pitch = points[:, 0], points[:, 1]
    return np.stack(
        [-np.sin(pitch), np.sin(roll) * np.cos(pitch), np.cos(roll) * np.cos(pitch)], axis=-1
    )


def read_imu(path: Path) -> Float[np.ndarray, "n 7"]:
    """Stamp, s since the first, turn rate, rad/s, specific force, m/s^2, of a EuRoC file."""
    try:
        table = np.loadtxt(path, delimiter=",")
    except (OSError, ValueError) as error:
        raise RecordingError(f"{path}: {error}; expected seven numbers a line") from error
    table[:, 0] = (table[:, 0] - table[0, 0]) * 1e-9
    return np.asarray(table)


def tilt(folder: Path) -> TiltOutcome:
    """Run over a EuRoC recording; at rest, then in flight."""
    path = folder / "imu0.csv.gz"
    with gzip.open(path, "rt", encoding="utf-8") as file:
        first_ns = int(next(line for line in file if not line.startswith("#")).split(",")[0])
    samples = read_imu(path)
    count = len(samples) // EVERY
    means = samples[: count * EVERY].reshape(count, EVERY, 7).mean(axis=1)
    robot = TiltFilter(means[:10, 4:7].mean(axis=0))
    checks = _vicon_up(folder, first_ns)
    dt = EVERY * float(np.median(np.diff(samples[:, 0])))
    rest_deg, flight = math.nan, []
    gyro_bias = force_bias = np.full(3, math.nan)
    for stamp, *values in means.tolist():
        robot.advance(np.array(values[:3]), np.array(values[3:]), dt, rests=stamp < REST_S)
        if math.isnan(rest_deg) and stamp >= REST_S:
            rest_deg = _angle_deg(robot.up, _floor_up(folder))
            gyro_bias, force_bias = robot.biases
        while checks and stamp >= checks[0][0]:
            flight.append(_angle_deg(robot.up, checks.pop(0)[1]))
    return TiltOutcome(rest_deg, max(flight), gyro_bias, force_bias)


def _floor_up(folder: Path) -> Float[np.ndarray, "3"]:
    """Normal of the floor at rest, axes of the IMU."""
    floors = real_data.floors(folder / "floor.csv")
    names = {path.stem for path in (folder / "static" / "cam0").glob("*.png")}
    normal = np.mean([plane.normal for name, plane in floors.items() if name in names], axis=0)
    text = (folder / "cam0.yaml").read_text(encoding="utf-8")
    numbers = text.split("data: [")[1].split("]")[0].split(",")
    T_imu_camera = np.array([float(number) for number in numbers]).reshape(4, 4)
    return np.asarray(T_imu_camera[:3, :3] @ normal)


def _vicon_up(folder: Path, first_ns: int) -> list[tuple[float, np.ndarray]]:
    """Stamps, s, and up in the axes of the IMU, where motion capture tells the attitude."""
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
