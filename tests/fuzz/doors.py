"""The doors through which files of others enter: small good files for each, and the function that reads them all."""

from __future__ import annotations

from pathlib import Path

import recording_doors
import result_doors
from door import Door

from sim.robots import catalogue
from sim.robots.jointed import jointed
from sim.scenes import scene_file
from surefoot.config import toml
from surefoot.config.schema import Config
from surefoot.evaluation.metrics.surfaces import read_surface

SETTINGS = """\
seed=3
scene="home"
reach.tof.farthest_m=2.5
depth_sources=["tof"]
grid.cell_m=0.05
robot.body=kinematic
mission.wander=true
gaze.mode=sweep
"""


def meshes(folder: Path) -> None:
    """Meshes in every text format, and one in binary."""
    import open3d as o3d

    box = o3d.geometry.TriangleMesh.create_box(0.4, 0.3, 0.2)
    box.compute_vertex_normals()
    for name in ("box.ply", "box.obj", "box.off", "box.stl"):
        assert o3d.io.write_triangle_mesh(str(folder / name), box, write_ascii=name != "box.stl")
    assert o3d.io.write_triangle_mesh(str(folder / "packed.ply"), box)
    cloud = o3d.geometry.PointCloud(box.vertices)
    assert o3d.io.write_point_cloud(str(folder / "points.pcd"), cloud)


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


def override(folder: Path) -> None:
    """Every line as one --set."""
    for line in (folder / "set").read_text("utf-8", "surrogateescape").splitlines():
        toml.override(Config(), [line])


LITTLE = Path(__file__).resolve().parents[1] / "little_robot"


def robot(folder: Path) -> None:
    """A robot of the tests: its description and its URDF."""
    for file in LITTLE.iterdir():
        (folder / file.name).write_bytes(file.read_bytes())


DOORS = {
    **recording_doors.DOORS,
    "config": Door(
        lambda folder: (folder / "c.toml").write_text(toml.dumps(Config())),
        lambda folder: toml.read(Config, folder / "c.toml"),
    ),
    "set": Door(lambda folder: (folder / "set").write_text(SETTINGS), override),
    "scene": Door(scene, lambda folder: scene_file.read_scene(folder / "scene.toml", 0), slow=True),
    "robot": Door(
        robot, lambda folder: jointed.__wrapped__(catalogue.read(folder / "little.toml")), slow=True
    ),
    "mesh": Door(
        meshes, lambda folder: [read_surface(path) for path in sorted(folder.iterdir())], slow=True
    ),
    **result_doors.DOORS,
}
