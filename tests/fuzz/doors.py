"""The doors through which files of others enter: small good files for each, and the function that reads them all."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from mapping.grid.egocentric_grid import EgocentricGrid, GridConfig
from mapping.io import geotiff, grid_file, nav2
from perception.primitives.camera import Camera
from perception.primitives.frame import ColourView, DepthView, Frame, Imu, StepOdometry
from perception.primitives.gaussian import Gaussian
from perception.primitives.obstacle import Obstacle
from perception.primitives.pose import Pose2, Pose3
from sim.scenes import scene_file
from surefoot.config import toml
from surefoot.config.schema import Config
from surefoot.evaluation.evaluate import evaluate
from surefoot.evaluation.foreign_graph import read_g2o
from surefoot.evaluation.foreign_trajectory import read_trajectory
from surefoot.evaluation.metrics.surfaces import read_surface
from surefoot.recordings.codec import encode
from surefoot.recordings.mcap_format import RecordingWriter
from surefoot.recordings.open import open_recording
from surefoot.recordings.recording import RecordingInfo
from surefoot.recordings.robot_log import open_robot_log
from surefoot.results import object_file
from surefoot.results.moment import Moment
from surefoot.results.moments import MomentWriter, read_moments
from surefoot.results.run_folder import RunFolder

WIDTH, HEIGHT = 16, 12
CAMERA = "[camera]\nwidth = 16\nheight = 12\nfx = 14.0\nfy = 14.0\ncx = 7.5\ncy = 5.5\n"
PLAIN = (
    f'name = "mine"\nrate_hz = 10.0\n{CAMERA}[depth]\nscale_per_metre = 1000\nnone = [0, 65535]\n'
)
POSES = "".join(f"{10 + k / 2:.4f} {k / 9} 2.0 3.0 0.0 0.0 0.6 0.8\n" for k in range(6))


@dataclass(frozen=True)
class Door:
    """One kind of input.

    Args:
        make: Writes good files into an empty folder.
        read: Reads all of them; may raise errors of the project, and nothing else.
    """

    make: Callable[[Path], object]
    read: Callable[[Path], object]


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
    (folder / "recording.toml").write_text(CAMERA)


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


def cloud(folder: Path) -> None:
    """Organised clouds."""
    v, u = np.mgrid[0:HEIGHT, 0:WIDTH]
    right, down = (u - 7.5) / 14.0, (v - 5.5) / 13.0
    z = 1.0 / (1.0 - right / 2)
    points = np.stack([right * z, down * z, z], axis=-1).reshape(-1, 3).astype("<f4")
    for kind in ("ascii", "binary"):
        head = (
            "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n"
            f"WIDTH {WIDTH}\nHEIGHT {HEIGHT}\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(points)}\nDATA {kind}\n"
        )
        lines = "".join(" ".join(f"{x:.6g}" for x in point) + "\n" for point in points)
        body = lines.encode() if kind == "ascii" else points.tobytes()
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


def robot_log(folder: Path) -> None:
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


def meshes(folder: Path) -> None:
    """Meshes in every text format, and one in binary."""
    import open3d as o3d

    box = o3d.geometry.TriangleMesh.create_box(0.4, 0.3, 0.2)
    box.compute_vertex_normals()
    for name in ("box.ply", "box.obj", "box.off", "box.stl"):
        assert o3d.io.write_triangle_mesh(str(folder / name), box, write_ascii=name != "box.stl")
    assert o3d.io.write_triangle_mesh(str(folder / "packed.ply"), box)


SCENE = f"""\
{scene_file.EXAMPLE}
[[model]]
file = "part.urdf"
at = [1.5, 1.0]
"""
URDF = """\
<?xml version="1.0"?>
<robot name="part"><link name="a"><visual><origin rpy="0 0 0.3" xyz="0 0 0.1"/>
<geometry><box size="0.2 0.2 0.2"/></geometry></visual></link>
<joint name="j" type="fixed"><parent link="a"/><child link="b"/><origin xyz="0 0 0.2"/></joint>
<link name="b"><visual><geometry><cylinder radius="0.1" length="0.2"/></geometry></visual></link></robot>
"""


def scene(folder: Path) -> None:
    """A scene with a model."""
    (folder / "scene.toml").write_text(SCENE)
    (folder / "part.urdf").write_text(URDF)


def maps(folder: Path) -> None:
    """Maps of a run."""
    rng = np.random.default_rng(3)
    probability = rng.uniform(0, 1, (9, 7)).astype(np.float32)
    known = rng.random((9, 7)) < 0.8
    nav2.save(folder, "map", probability, known, np.zeros(2), 0.05)
    nav2.save_scale(folder, "scale", probability, known, np.zeros(2), 0.05)
    geotiff.save(folder / "layers.tif", {"height": probability}, np.zeros(2), 0.05)
    grid_file.save(folder / "terrain.npz", EgocentricGrid(GridConfig(), np.zeros(2)))


def read_maps(folder: Path) -> None:
    """All of them."""
    for name in ("map.yaml", "scale.yaml"):
        nav2.load(folder / name)
    geotiff.load(folder / "layers.tif")
    grid_file.load(folder / "terrain.npz")


def trajectories(folder: Path) -> None:
    """Estimates of others."""
    (folder / "tum.txt").write_text(POSES)
    (folder / "kitti.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0 0.1 0 1 0 0 0 0 1 0\n")
    euroc = "".join(f"{k}00000000,0.1,0.2,0.3,1,0,0,0\n" for k in range(1, 4))
    (folder / "euroc.csv").write_text("#timestamp, x, y, z, qw, qx, qy, qz\n" + euroc)
    information = " ".join("1" if i == j else "0" for i in range(6) for j in range(i, 6))
    vertices = "".join(f"VERTEX_SE3:QUAT {k} {k} 0 0 0 0 0 1\n" for k in range(3))
    edges = "".join(f"EDGE_SE3:QUAT {k} {k + 1} 1 0 0 0 0 0 1 {information}\n" for k in range(2))
    (folder / "graph.g2o").write_text(vertices + edges)


def read_trajectories(folder: Path) -> None:
    """All of them."""
    for name in ("tum.txt", "kitti.txt", "euroc.csv"):
        read_trajectory(folder / name)
    read_g2o(folder / "graph.g2o")


def run_folder(folder: Path) -> None:
    """A small run with its truth."""
    run = RunFolder.create(folder)
    run.write_text("trajectory.txt", POSES)
    rows = [(10 + k / 2, 0.1 * k, 0.0, 0.0, 1e-4, 0.0, 0.0, 1e-4, 0.0, 1e-4) for k in range(6)]
    header = (
        "stamp_s",
        "x_m",
        "y_m",
        "yaw_rad",
        "P_xx",
        "P_xy",
        "P_xyaw",
        "P_yy",
        "P_yyaw",
        "P_yawyaw",
    )
    run.write_csv("trajectory_covariance.csv", header, rows)
    run.write_json("summary.json", {"kind": "simulation", "name": "x", "frames": 6, "seconds": 2.5})
    run.write_text("truth/trajectory.txt", POSES)


def objects(folder: Path) -> None:
    """What a checkpoint is made of."""
    value = [
        Config(),
        np.arange(9.0),
        Pose2(1.0, 2.0, 3.0),
        np.random.default_rng(1),
        {"a": (1, 2)},
    ]
    (folder / "state").write_bytes(object_file.dumps(value))


def estimates(folder: Path) -> None:
    """What a run knew at two moments."""
    run, state = RunFolder.create(folder), Gaussian(np.zeros(4), np.eye(4))
    writer = MomentWriter(run)
    for k in range(2):
        track = Obstacle(state, 0.1, 0.4, 3, 0.5, 1.0, 0.0)
        pose = Gaussian(np.array([0.1 * k, 0.0, 0.0]), 1e-4 * np.eye(3))
        depth = np.full((12, 16), 30 + k, np.uint8)
        writer.write(
            Moment(1.0 + k, pose, tracks=(track,), why="walk", depth=depth, depth_step_m=0.01)
        )
    writer.close(())


def frames(folder: Path) -> None:
    """Every frame of a recording."""
    for _ in open_recording(folder).frames():
        pass


def clouds(folder: Path) -> None:
    """Both clouds."""
    for path in sorted(folder.glob("*.pcd")):
        for _ in open_recording(path).frames():
            pass


DOORS = {
    "tum": Door(tum, frames),
    "seven_scenes": Door(seven_scenes, frames),
    "redwood": Door(redwood, frames),
    "replica": Door(replica, frames),
    "plain": Door(plain, frames),
    "icl": Door(icl, frames),
    "pcd": Door(cloud, clouds),
    "mcap": Door(recording, frames),
    "robot_log": Door(robot_log, open_robot_log),
    "config": Door(
        lambda folder: (folder / "c.toml").write_text(toml.dumps(Config())),
        lambda folder: toml.read(Config, folder / "c.toml"),
    ),
    "scene": Door(scene, lambda folder: scene_file.read_scene(folder / "scene.toml", 0)),
    "mesh": Door(meshes, lambda folder: [read_surface(path) for path in sorted(folder.iterdir())]),
    "maps": Door(maps, read_maps),
    "trajectories": Door(trajectories, read_trajectories),
    "run_folder": Door(run_folder, lambda folder: evaluate(RunFolder.open(folder))),
    "estimates": Door(estimates, lambda folder: list(read_moments(RunFolder(folder)))),
    "objects": Door(objects, lambda folder: object_file.loads((folder / "state").read_bytes())),
}
