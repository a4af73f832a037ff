"""Small recordings of every layout, written independently of the readers."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from perception.primitives.camera import Camera
from perception.primitives.frame import (
    ColourView,
    DepthView,
    Frame,
    Imu,
    RangeView,
    StepOdometry,
    StereoView,
)
from perception.primitives.pose import Pose2, Pose3

WIDTH, HEIGHT = 16, 12
VIDEO_PX = 1920  # width of the video of an iPhone
TOML = """\
rate_hz = 10.0
[camera]
width = 16
height = 12
fx = 14.0
fy = 14.0
cx = 7.5
cy = 5.5
[depth]
scale_per_metre = 1000
none = [0, 65535]
"""


def depth_units(index: int) -> np.ndarray:
    """A ramp with one hole, different for each frame."""
    units = (1000 + 10 * index + np.arange(WIDTH * HEIGHT)).reshape(HEIGHT, WIDTH).astype(np.uint16)
    units[0, 0] = 0
    return units


def write_image(path: Path, image: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), image)


def write_pair(depth: Path, colour: Path, index: int) -> None:
    write_image(depth, depth_units(index))
    write_image(colour, np.full((HEIGHT, WIDTH, 3), (10, 20, 200), np.uint8))


def tum_line(stamp: float) -> str:
    return f"{stamp:.4f} {stamp:.4f} 2.0 3.0 0.0 0.0 0.6 0.8\n"


def lzf(data: bytes) -> bytes:
    """A greedy LZF packer: back references where three bytes were seen before, else literals."""
    seen: dict[bytes, int] = {}
    out, literals, i = bytearray(), bytearray(), 0

    def flush() -> None:
        for k in range(0, len(literals), 32):
            part = literals[k : k + 32]
            out.append(len(part) - 1)
            out.extend(part)
        literals.clear()

    while i < len(data):
        key = data[i : i + 3]
        start = seen.get(key, -1) if len(key) == 3 else -1
        seen[key] = i
        distance = i - start - 1
        if start < 0 or distance >= 8192:
            literals.append(data[i])
            i += 1
            continue
        length = 3
        while i + length < len(data) and length < 264 and data[start + length] == data[i + length]:
            length += 1
        flush()
        code = length - 2
        out.append((min(code, 7) << 5) | (distance >> 8))
        if code >= 7:
            out.append(code - 7)
        out.append(distance & 255)
        i += length
    flush()
    return bytes(out)


@pytest.fixture
def tum(tmp_path: Path) -> Path:
    """Four frames of the thinned layout."""
    path = tmp_path / "fr3_small"
    for i in range(4):
        write_pair(path / f"depth/{i:04d}.png", path / f"rgb/{i:04d}.png", i)
    lines = "".join(tum_line(10.0 + i / 2) for i in range(4))
    (path / "groundtruth.txt").write_text("# timestamp tx ty tz qx qy qz qw\n" + lines)
    (path / "recording.toml").write_text(TOML[TOML.index("[camera]") : TOML.index("[depth]")])
    return path


@pytest.fixture
def tum_listed(tmp_path: Path) -> Path:
    """Four frames of the whole layout: stamps of colour, depth and poses differ by a few ms."""
    path = tmp_path / "freiburg3_small"
    for i in range(4):
        write_pair(path / f"depth/{i + 0.5:.4f}.png", path / f"rgb/{i + 0.512:.4f}.png", i)
    (path / "depth.txt").write_text(
        "# depth maps\n" + "".join(f"{i + 0.5} depth/{i + 0.5:.4f}.png\n" for i in range(4))
    )
    (path / "rgb.txt").write_text(
        "".join(f"{i + 0.512} rgb/{i + 0.512:.4f}.png\n" for i in range(4))
    )
    (path / "groundtruth.txt").write_text("".join(tum_line(0.01 * k) for k in range(300)))
    (path / "recording.toml").write_text(TOML[TOML.index("[camera]") : TOML.index("[depth]")])
    return path


@pytest.fixture
def seven_scenes(tmp_path: Path) -> Path:
    """Three frames, every fourth of the original."""
    path = tmp_path / "kitchen" / "seq-01"
    for i in range(3):
        stem = f"frame-{4 * i:06d}"
        write_pair(path / f"{stem}.depth.png", path / f"{stem}.color.png", i)
        pose = np.eye(4)
        pose[:3, 3] = (i, 2.0, 3.0)
        np.savetxt(path / f"{stem}.pose.txt", pose)
    np.savetxt(path.parent / "camera-intrinsics.txt", [[14.0, 0, 7.5], [0, 14.0, 5.5], [0, 0, 1]])
    np.savetxt(path.parent / "gravity-direction.txt", [0.0, 0.6, 0.8])
    return path


@pytest.fixture
def redwood(tmp_path: Path) -> Path:
    """Three frames with a rendered, upright camera."""
    path = tmp_path / "room"
    log = ""
    for i in range(3):
        write_pair(path / f"depth/{i:05d}.png", path / f"color/{i:05d}.png", i)
        log += f"{i} {i} {i + 1}\n1 0 0 {i}\n0 -1 0 0.5\n0 0 -1 0\n0 0 0 1\n"
    (path / "trajectory.log").write_text(log)
    intrinsics = {
        "width": WIDTH,
        "height": HEIGHT,
        "intrinsic_matrix": [14.0, 0, 0, 0, 15.0, 0, 7.5, 5.5, 1],
    }
    (path / "camera_primesense.json").write_text(json.dumps(intrinsics))
    return path


@pytest.fixture
def replica(tmp_path: Path) -> Path:
    """Two frames."""
    path = tmp_path / "office"
    for i in range(2):
        write_pair(path / f"depth{i:06d}.png", path / f"frame{i:06d}.png", i)
    camera = {"w": WIDTH, "h": HEIGHT, "fx": 14, "fy": 14, "cx": 7.5, "cy": 5.5, "scale": 6553.5}
    (path / "cam_params.json").write_text(json.dumps({"camera": camera}))
    np.savetxt(path / "traj.txt", np.tile(np.eye(4).ravel(), (2, 1)))
    return path


@pytest.fixture
def stray_scanner(tmp_path: Path) -> Path:
    """Three frames of an iPhone; the last one has no pose."""
    path = tmp_path / "71de12f9"
    level = np.full((HEIGHT, WIDTH), 2, np.uint8)
    level[:, :3] = 0
    for i in range(3):
        write_image(path / f"depth/{i:06d}.png", depth_units(i))
        write_image(path / f"confidence/{i:06d}.png", level)
    s = VIDEO_PX / WIDTH
    (path / "camera_matrix.csv").write_text(
        f"{14 * s}, 0.0, {8 * s - 0.5}\n0.0, {14 * s}, {6 * s - 0.5}\n0.0, 0.0, 1.0\n"
    )
    half = 0.5**0.5
    (path / "odometry.csv").write_text(
        "timestamp, frame, x, y, z, qx, qy, qz, qw, fx, fy, cx, cy, distortion_center_x, distortion_center_y\n"
        + "".join(
            f"{65575.5 + 0.1 * i}, {i:06d}, {0.1 * i}, 1.4, 0.0, {half}, {-half}, 0.0, 0.0, 1, 1, 1, 1, , \n"
            for i in range(2)
        )
    )
    return path


@pytest.fixture
def plain(tmp_path: Path) -> Path:
    """Three frames with a recording.toml."""
    path = tmp_path / "mine"
    for i in range(3):
        write_pair(path / f"depth/{i}.png", path / f"color/{i}.png", i)
    (path / "recording.toml").write_text(TOML)
    return path


@pytest.fixture
def pcd(tmp_path: Path) -> Callable[[str], Path]:
    """An organised cloud of the plane z = 1 + x/2, in any of PCD's three encodings."""

    def write(data: str) -> Path:
        v, u = np.mgrid[0:HEIGHT, 0:WIDTH]
        slope_x, slope_y = (u - 7.5) / 14.0, (v - 5.5) / 13.0
        z = 1.0 / (1.0 - slope_x / 2)
        cloud = np.stack([slope_x * z, slope_y * z, z], axis=-1).reshape(-1, 3).astype("<f4")
        cloud[5] = np.nan
        header = (
            "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n"
            f"WIDTH {WIDTH}\nHEIGHT {HEIGHT}\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {WIDTH * HEIGHT}\n"
            f"DATA {data}\n"
        )
        lines = "".join(" ".join(f"{x:.9g}" for x in p) + "\n" for p in cloud)
        packed = lzf(cloud.T.tobytes())
        sizes = np.array([len(packed), cloud.nbytes], "<u4").tobytes()
        body = {
            "ascii": lines.encode(),
            "binary": cloud.tobytes(),
            "binary_compressed": sizes + packed,
        }
        path = tmp_path / f"{data}.pcd"
        path.write_bytes(header.encode() + body[data])
        return path

    return write


@pytest.fixture(scope="session")
def make_frame() -> Callable[..., Frame]:
    """A frame with every part, full of noise; keyword arguments replace parts."""

    def make(seed: int, **parts: object) -> Frame:
        rng = np.random.default_rng(seed)
        camera = Camera.from_view(32, 24, 0.8, 0.6)
        lens = Camera(40, 30, 35.5, 36.25, 19.0, 15.0, (0.1, -0.2, 0.003, -0.004, 0.05))
        rational = replace(lens, distortion=(*lens.distortion, 0.02, -0.01, 0.004))
        T_body_camera = Pose3(tuple(rng.normal(size=3).tolist()), (0.5, -0.5, 0.5, -0.5))
        distance = rng.uniform(0.3, 6.0, (24, 32)).astype(np.float32)
        distance[rng.random((24, 32)) < 0.2] = np.nan
        amplitude = np.float32(3.0) / distance**2
        grey = rng.integers(0, 256, (30, 40), dtype=np.uint8)
        ramp = np.linspace(0, 255, 40 * 30 * 3).reshape(30, 40, 3)
        rgb = np.clip(ramp + rng.normal(0, 2, ramp.shape), 0, 255).astype(np.uint8)
        values: dict[str, object] = {
            "stamp_s": 0.1 * seed + float(rng.uniform(0, 0.05)),
            "tof": RangeView(distance, amplitude, camera, T_body_camera),
            "depth": DepthView(distance[::-1].copy(), camera, None),
            "stereo": StereoView(grey, grey[:, ::-1].copy(), 0.04, lens, T_body_camera),
            "colour": ColourView(rgb, rational, T_body_camera),
            "odometry": StepOdometry(Pose2(*rng.normal(size=3).tolist()), 0.5),
            "imu": Imu(rng.normal(size=3), rng.normal(size=3)),
            "T_world_camera": Pose3((1.0, 2.0, -0.0), (0.1, 0.2, 0.3, float(np.sqrt(0.86)))),
            "footstep_due": bool(seed % 2),
        }
        values.update(parts)
        return Frame(**values)  # type: ignore[arg-type]

    return make


@pytest.fixture(scope="session")
def same() -> Callable[[object, object], bool]:
    """Whether two frames (or parts of them) are equal in type and in every bit."""

    def equal(a: object, b: object) -> bool:
        if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
            return a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()
        if isinstance(a, float) and isinstance(b, float):
            return np.float64(a).tobytes() == np.float64(b).tobytes()
        if isinstance(a, tuple) and isinstance(b, tuple):
            return len(a) == len(b) and all(map(equal, a, b))
        if hasattr(a, "__dataclass_fields__") and type(a) is type(b):
            return all(equal(getattr(a, f), getattr(b, f)) for f in a.__dataclass_fields__)
        return a == b

    return equal


@pytest.fixture(scope="session")
def lzf_packer() -> Callable[[bytes], bytes]:
    """The packer, for tests of the unpacker."""
    return lzf
