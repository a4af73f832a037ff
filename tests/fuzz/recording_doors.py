"""Doors of recordings: a small good one of every format, and what reads all of its frames."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import cv2
import numpy as np

from perception.primitives.camera import Camera
from perception.primitives.frame import (
    ColourView,
    DepthView,
    FeetReading,
    Frame,
    Imu,
    StepOdometry,
)
from perception.primitives.pose import Pose2, Pose3
from surefoot.config.schema import Config
from surefoot.recordings.codec import encode
from surefoot.recordings.mcap_format import RecordingWriter
from surefoot.recordings.open import open_recording
from surefoot.recordings.recording import RecordingInfo
from surefoot.recordings.robot_log import open_robot_log
from surefoot.run.level_pipeline import make_pipeline

sys.path.insert(0, str(Path(__file__).parents[1] / "surefoot" / "recordings"))

from bags import write_bag
from door import Door

WIDTH, HEIGHT = 16, 12
CAMERA = "[camera]\nwidth = 16\nheight = 12\nfx = 14.0\nfy = 14.0\ncx = 7.5\ncy = 5.5\n"
PLAIN = (
    f'name = "mine"\nrate_hz = 10.0\n{CAMERA}[depth]\nscale_per_metre = 1000\nnone = [0, 65535]\n'
)
EPOCH_NS = 1_403_715_273_262_142_976
POSES = "".join(f"{10 + k / 2:.4f} {k / 9} 2.0 3.0 0.0 0.0 0.6 0.8\n" for k in range(6))


def picture(path: Path, image: np.ndarray) -> None:
    """Write an image, with its folder."""
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), image)


def pair(depth: Path, colour: Path) -> None:
    """A depth and a colour image."""
    units = (1000 + np.arange(WIDTH * HEIGHT)).reshape(HEIGHT, WIDTH).astype(np.uint16)
    picture(depth, units)
    picture(colour, np.full((HEIGHT, WIDTH, 3), (10, 20, 200), np.uint8))


def tum(folder: Path) -> None:
    """As TUM RGB-D."""
    for k in range(3):
        pair(folder / f"depth/{k}.png", folder / f"rgb/{k}.png")
    for name in ("depth", "rgb"):
        lines = (f"{10 + k / 2:.4f} {name}/{k}.png\n" for k in range(3))
        (folder / f"{name}.txt").write_text("# list\n" + "".join(lines))
    (folder / "groundtruth.txt").write_text("# stamp tx ty tz qx qy qz qw\n" + POSES)
    (folder / "recording.toml").write_text(CAMERA + "[depth]\nscale_per_metre = 1000\nnone = [0]\n")


def eth3d(folder: Path) -> None:
    """As ETH3D: the layout of TUM with its intrinsics."""
    tum(folder)
    (folder / "recording.toml").unlink()
    (folder / "calibration.txt").write_text("14.0 14.0 7.5 5.5\n")


def scannet(folder: Path) -> None:
    """As ScanNet's exporter writes them; the second frame was not tracked."""
    for k, pose in enumerate((np.eye(4), np.full((4, 4), -np.inf), np.eye(4))):
        pair(folder / f"depth/{20 * k}.png", folder / f"color/{20 * k}.jpg")
        (folder / "pose").mkdir(exist_ok=True)
        np.savetxt(folder / f"pose/{20 * k}.txt", pose, fmt="%f")
    (folder / "intrinsic").mkdir()
    for kind, f in (("depth", 14.0), ("color", 15.0)):
        k = [[f, 0, 7.5, 0], [0, f, 5.5, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
        np.savetxt(folder / f"intrinsic/intrinsic_{kind}.txt", k, fmt="%f")


def stray_scanner(folder: Path) -> None:
    """As Stray Scanner writes them."""
    for k in range(2):
        pair(folder / f"depth/{k:06d}.png", folder / f"confidence/{k:06d}.png")
        picture(folder / f"confidence/{k:06d}.png", np.full((HEIGHT, WIDTH), 2, np.uint8))
    (folder / "camera_matrix.csv").write_text("1680, 0, 960\n0, 1680, 720\n0, 0, 1\n")
    lines = (
        f"{10 + k / 2}, {k:06d}, 0, 1, {0.1 * k}, 0.6, -0.8, 0, 0, 1, 1, 1, 1, ,\n"
        for k in range(2)
    )
    head = "timestamp, frame, x, y, z, qx, qy, qz, qw, fx, fy, cx, cy, distortion_center_x,\n"
    (folder / "odometry.csv").write_text(head + "".join(lines))


def seven_scenes(folder: Path) -> None:
    """As 7-Scenes."""
    for k in range(2):
        stem = f"frame-{k:06d}"
        pair(folder / f"{stem}.depth.png", folder / f"{stem}.color.png")
        np.savetxt(folder / f"{stem}.pose.txt", np.eye(4))
    np.savetxt(folder / "camera-intrinsics.txt", [[14.0, 0, 7.5], [0, 14.0, 5.5], [0, 0, 1]])


def redwood(folder: Path) -> None:
    """As Redwood and Open3D."""
    for k in range(2):
        pair(folder / f"depth/{k:05d}.png", folder / f"color/{k:05d}.png")
    rows = "1 0 0 0\n0 -1 0 0.5\n0 0 -1 0\n0 0 0 1\n"
    (folder / "trajectory.log").write_text("".join(f"{k} {k} {k + 1}\n{rows}" for k in range(2)))
    matrix = [14.0, 0, 0, 0, 15.0, 0, 7.5, 5.5, 1]
    values = {"width": WIDTH, "height": HEIGHT, "intrinsic_matrix": matrix}
    (folder / "camera_primesense.json").write_text(json.dumps(values))


def replica(folder: Path) -> None:
    """As Replica."""
    for k in range(2):
        pair(folder / f"results/depth{k:06d}.png", folder / f"results/frame{k:06d}.png")
    camera = {"w": WIDTH, "h": HEIGHT, "fx": 14, "fy": 14, "cx": 7.5, "cy": 5.5, "scale": 6553.5}
    (folder / "cam_params.json").write_text(json.dumps({"camera": camera}))
    np.savetxt(folder / "traj.txt", np.tile(np.eye(4).ravel(), (2, 1)))


def plain(folder: Path) -> None:
    """Depth images with a recording.toml."""
    for k in range(2):
        pair(folder / f"depth/{k}.png", folder / f"color/{k}.png")
    (folder / "recording.toml").write_text(PLAIN + '[poses]\nfile = "poses.txt"\n')
    (folder / "poses.txt").write_text("".join(POSES.splitlines(keepends=True)[:2]))


def poses(folder: Path) -> None:
    """Descriptions with poses in every form: lines of 7, 12 and 16 numbers, and a file each."""
    values = {"tx": [1.0, 2, 3, 0, 0, 0.6, 0.8], "kitti": np.eye(4)[:3], "matrix": np.eye(4)}
    for form, value in values.items():
        plain(folder / form)
        np.savetxt(folder / form / "poses.txt", np.tile(np.ravel(value), (2, 1)), fmt="%g")
    plain(folder / "files")
    toml = folder / "files/recording.toml"
    toml.write_text(toml.read_text().replace('file = "poses.txt"', 'folder = "pose"'))
    (folder / "files/poses.txt").unlink()
    (folder / "files/pose").mkdir()
    for k in range(2):
        np.savetxt(folder / f"files/pose/{k}.txt", np.eye(4), fmt="%g")


def floats(folder: Path) -> None:
    """Depth images of floats: TIFF and arrays of NumPy."""
    metres = np.linspace(1.0, 2.0, WIDTH * HEIGHT, dtype=np.float32).reshape(HEIGHT, WIDTH)
    for kind in ("tiff", "npy"):
        (folder / kind / "depth").mkdir(parents=True)
        (folder / kind / "recording.toml").write_text(PLAIN.replace("= 1000", "= 1"))
    for k in range(2):
        picture(folder / f"tiff/depth/{k}.tiff", metres)
        np.save(folder / f"npy/depth/{k}.npy", metres)


def icl(folder: Path) -> None:
    """As ICL-NUIM."""
    lines = []
    for k in range(2):
        picture(folder / f"depth/{k}.png", np.full((480, 640), 9000, np.uint16))
        picture(folder / f"rgb/{k}.png", np.full((480, 640, 3), 90, np.uint8))
        lines.append(f"{k} depth/{k}.png {k} rgb/{k}.png\n")
    (folder / "associations.txt").write_text("".join(lines))
    truth = "".join(f"{k} 0.0 1.2 0.0 0.2 0.0 0.0 0.98\n" for k in range(2))
    (folder / "livingRoom0.gt.freiburg").write_text(truth)


def euroc(folder: Path) -> None:
    """As EuRoC."""
    grey = (np.arange(WIDTH * HEIGHT) % 251).reshape(HEIGHT, WIDTH).astype(np.uint8)
    for name, across in (("cam0", 0.0), ("cam1", 0.1)):
        for k in range(2):
            picture(folder / f"{name}/data/{EPOCH_NS + 50_000_000 * k}.png", grey)
        (folder / name / "sensor.yaml").write_text(
            "sensor_type: camera\nT_BS:\n  cols: 4\n  rows: 4\n"
            f"  data: [1.0, 0, 0, {across}, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]\n"
            f"resolution: [{WIDTH}, {HEIGHT}]\ncamera_model: pinhole\nintrinsics: [14.0, 14.0, 7.5, 5.5]\n"
            "distortion_model: radial-tangential\ndistortion_coefficients: [0.01, -0.01, 0.0, 0.0]\n"
        )
    (folder / "imu0").mkdir()
    rows = "".join(
        f"{EPOCH_NS - 10_000_000 + 5_000_000 * k},0.1,0.0,0.0,9.8,0.0,0.1\n" for k in range(20)
    )
    (folder / "imu0/data.csv").write_text("#timestamp,wx,wy,wz,ax,ay,az\n" + rows)
    (folder / "state_groundtruth_estimate0").mkdir()
    rows = "".join(f"{EPOCH_NS + 50_000_000 * k},0.1,0,1,1,0,0,0\n" for k in range(2))
    (folder / "state_groundtruth_estimate0/data.csv").write_text("#t,x,y,z,w,x,y,z\n" + rows)


def stereo(folder: Path) -> None:
    """Rectified pairs with calibrations of ROS, and one folder of OpenCV."""
    grey = (np.arange(WIDTH * HEIGHT) % 251).reshape(HEIGHT, WIDTH).astype(np.uint8)
    for kind in ("ros", "opencv"):
        for side in ("left", "right"):
            for k in range(2):
                picture(folder / kind / f"{side}/{k}.png", grey)
    for side, last in (("left", 0.0), ("right", -1.4)):
        (folder / f"ros/{side}.yaml").write_text(
            f"image_width: {WIDTH}\nimage_height: {HEIGHT}\nprojection_matrix:\n  rows: 3\n  cols: 4\n"
            f"  data: [14.0, 0, 7.5, {last}, 0, 14.0, 5.5, 0, 0, 0, 1, 0]\n"
        )
    storage = cv2.FileStorage(str(folder / "opencv/extrinsics.yml"), cv2.FILE_STORAGE_WRITE)
    for name, last in (("P1", 0.0), ("P2", -1.4)):
        storage.write(name, np.array([[14.0, 0, 7.5, last], [0, 14.0, 5.5, 0], [0, 0, 1, 0]]))
    storage.release()


def cloud(folder: Path) -> None:
    """Organised clouds."""
    v, u = np.mgrid[0:HEIGHT, 0:WIDTH]
    right, down = (u - 7.5) / 14.0, (v - 5.5) / 13.0
    z = 1.0 / (1.0 - right / 2)
    points = np.stack([right * z, down * z, z], axis=-1).reshape(-1, 3).astype("<f4")
    columns = points.T.tobytes()
    literals = b"".join(
        bytes([len(part) - 1]) + part
        for part in (columns[k : k + 32] for k in range(0, len(columns), 32))
    )
    sizes = len(literals).to_bytes(4, "little") + len(columns).to_bytes(4, "little")
    lines = "".join(" ".join(f"{x:.6g}" for x in point) + "\n" for point in points)
    bodies = {"ascii": lines.encode(), "binary": points.tobytes(), "binary_compressed": sizes + literals}  # fmt: skip
    for kind, body in bodies.items():
        head = (
            "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n"
            f"WIDTH {WIDTH}\nHEIGHT {HEIGHT}\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(points)}\nDATA {kind}\n"
        )
        (folder / f"{kind}.pcd").write_bytes(head.encode() + body)


def recording(folder: Path) -> None:
    """As `simulate --record`."""
    camera = Camera.from_view(32, 24, 0.8, 0.6)
    rng = np.random.default_rng(2)
    with RecordingWriter(folder / "recording.mcap", RecordingInfo("walk", "simulation")) as writer:
        for k in range(3):
            frame = Frame(
                0.5 * k,
                depth=DepthView(rng.uniform(1, 3, (24, 32)).astype(np.float32), camera),
                colour=ColourView(rng.integers(0, 256, (24, 32, 3), dtype=np.uint8), camera),
                odometry=StepOdometry(Pose2(0.1, 0.0, 0.0), 1.0),
                imu=Imu(rng.normal(size=3), rng.normal(size=3)),
                T_world_camera=Pose3((0.1 * k, 0.0, 1.0)),
            )
            writer.write(encode(frame))


def climb(folder: Path) -> None:
    """As `simulate storeys --record`: a step of 8 cm before the robot, and where its feet are."""
    camera = Camera.from_view(64, 48, 1.2, 0.9)
    tilt = 0.7
    right, ahead = [0.0, -1.0, 0.0], [np.cos(tilt), 0.0, -np.sin(tilt)]
    T = Pose3.from_rotation(
        np.column_stack([right, np.cross(ahead, right), ahead]), np.array([0.0, 0.0, 1.0])
    )
    rays = camera.rays @ T.rotation.T
    with np.errstate(divide="ignore", invalid="ignore"):
        floor, step = (
            np.where(rays[..., 2] < 0.0, (z - 1.0) / rays[..., 2], np.inf) for z in (0.0, 0.08)
        )
        riser = np.where(rays[..., 0] > 0.0, 0.8 / rays[..., 0], np.inf)
    z = np.where(step * rays[..., 0] > 0.8, step, np.minimum(floor, riser))
    start = {"start": Pose2(), "start_covariance": 1e-4 * np.eye(3), "calibrated": True}
    info = RecordingInfo("climb", "simulation", levels=True, **start)
    rng = np.random.default_rng(3)
    with RecordingWriter(folder / "recording.mcap", info) as writer:
        for k in range(6):
            noisy = (z + rng.normal(0.0, 0.002, z.shape)).astype(np.float32)
            sign = 1.0 if k % 2 else -1.0
            frame = Frame(
                0.5 * k,
                depth=DepthView(noisy, camera, T),
                odometry=StepOdometry(Pose2(0.05, 0.0, 0.0), 1.0),
                imu=Imu(np.zeros(3), np.array([0.0, 0.0, 9.81])),
                footstep_due=True,
                feet=FeetReading(Pose2(0.025 * sign, 0.1), Pose2(-0.025 * sign, -0.1)),
            )
            writer.write(encode(frame))


def mrclam(folder: Path) -> None:
    """As MRCLAM."""
    files = {
        "Barcodes.dat": "# subject, barcode\n 1 5\n 6 63\n",
        "Landmark_Groundtruth.dat": " 6 0.5 -4.0 0.0 0.0\n",
        "Robot1_Measurement.dat": " 10.0 63 2.0 0.1\n 11.0 63 3.0 0.2\n",
        "Robot1_Odometry.dat": " 9.0 0.1 0.0\n 10.0 0.1 0.2\n 11.0 0.1 0.2\n",
        "Robot1_Groundtruth.dat": " 9.0 0.0 0.0 3.1\n 10.0 0.1 0.0 -3.1\n",
    }
    for name, text in files.items():
        (folder / name).write_text(text)


def plaza(folder: Path) -> None:
    """As Plaza, packed and not."""
    from scipy.io import savemat

    stamps = np.arange(5.0)[:, None]
    tables = {
        "DR": np.hstack([stamps, np.full((5, 1), 0.1), np.zeros((5, 1))]),
        "TD": np.hstack([stamps, np.zeros((5, 1)), np.full((5, 1), 7.0), np.full((5, 1), 2.0)]),
        "TL": np.array([[7.0, 1.0, 2.0]]),
        "GT": np.hstack([stamps, stamps, stamps, np.zeros((5, 1))]),
    }
    for name, packed in (("packed", True), ("plain", False)):
        savemat(folder / f"{name}.mat", tables, do_compression=packed)


def frames(folder: Path) -> None:
    """Every frame of a recording."""
    for _ in open_recording(folder).frames():
        pass


def levels(folder: Path) -> None:
    """Every frame of a recording over several levels, by the pipeline for such ground."""
    found = open_recording(folder)
    pipeline = make_pipeline(Config(), found.info)
    for frame in found.frames():
        pipeline.cycle(frame)


def frames_of_each(pattern: str):
    """Every frame of every recording in the folder."""

    def read(folder: Path) -> None:
        for path in sorted(folder.glob(pattern)):
            frames(path)

    return read


def logs(folder: Path) -> None:
    """Every robot log in the folder."""
    for path in sorted(folder.glob("*.mat")):
        open_robot_log(path)


DOORS = {
    "tum": Door(tum, frames),
    "eth3d": Door(eth3d, frames),
    "scannet": Door(scannet, frames),
    "stray_scanner": Door(stray_scanner, frames),
    "seven_scenes": Door(seven_scenes, frames),
    "redwood": Door(redwood, frames),
    "replica": Door(replica, frames),
    "plain": Door(plain, frames),
    "poses": Door(poses, frames_of_each("*")),
    "floats": Door(floats, frames_of_each("*")),
    "icl": Door(icl, frames),
    "euroc": Door(euroc, frames),
    "stereo": Door(stereo, frames_of_each("*")),
    "pcd": Door(cloud, frames_of_each("*.pcd")),
    "mcap": Door(recording, frames),
    "levels": Door(climb, levels, slow=True),
    "ros1": Door(lambda folder: write_bag(folder / "a", "ros1", 2), frames_of_each("*.bag")),
    "ros2": Door(lambda folder: write_bag(folder / "a", "ros2", 2), frames_of_each("a")),
    "ros2_mcap": Door(lambda folder: write_bag(folder / "a", "mcap", 2), frames_of_each("a")),
    "mrclam": Door(mrclam, open_robot_log),
    "plaza": Door(plaza, logs),
}
