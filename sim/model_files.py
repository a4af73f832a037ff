"""Models that a user brings, as solids: meshes (OBJ, STL, PLY, glTF) and URDF files.

Of a URDF every link is placed with its joints at zero, and what it looks like is taken, or, where it says
nothing of that, what it collides with.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from perception.primitives.errors import InputError

from .shapes import Solid

MESHES = (".obj", ".stl", ".ply", ".off", ".gltf", ".glb")
MOST_TRIANGLES = 50_000  # rays and pictures of a scene stay quick
_THINNEST_M = 1e-4


def read_model(path: Path, material: str = "plaster/grey") -> tuple[Solid, ...]:
    """The solids of a model about its own origin, z up, m; one for each piece that hangs together.

    Args:
        path: Mesh or URDF.
        material: What it looks like.

    Raises:
        InputError: Absent, of another kind, empty, flat or too large.
    """
    if not path.is_file():
        raise InputError(
            f"{path}: no such file; a mesh ({', '.join(MESHES)}) or a .urdf was expected"
        )
    if path.suffix.lower() == ".urdf":
        meshes = _read_urdf(path)
    elif path.suffix.lower() in MESHES:
        meshes = [_read_mesh(path)]
    else:
        raise InputError(
            f"{path}: a model of kind {path.suffix or 'unknown'} is not read; expected "
            f"{', '.join(MESHES)} or .urdf"
        )
    count = sum(len(mesh.triangles) for mesh in meshes)
    if count > MOST_TRIANGLES:
        raise InputError(
            f"{path}: {count} triangles; at most {MOST_TRIANGLES} are taken, simplify the mesh"
        )
    solids = tuple(solid for mesh in meshes for solid in _pieces(mesh, material))
    if not solids:
        raise InputError(f"{path}: holds no surface with a volume; a closed mesh was expected")
    return solids


def placed(
    solids: tuple[Solid, ...], at: tuple[float, float, float], yaw_rad: float, scale: float = 1.0
) -> tuple[Solid, ...]:
    """The same, scaled, turned about the vertical and put somewhere."""
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return tuple(
        Solid(scale * one.vertices @ R.T + np.array(at), one.triangles, one.material)
        for one in solids
    )


def _read_mesh(path: Path) -> Any:
    o3d = _open3d()
    with o3d.utility.VerbosityContextManager(o3d.utility.VerbosityLevel.Error):
        mesh = o3d.io.read_triangle_mesh(str(path))
    if not len(mesh.triangles):
        raise InputError(f"{path}: holds no triangles that Open3D can read")
    return mesh


def _pieces(mesh: Any, material: str) -> list[Solid]:
    """What hangs together is one solid; slivers without a width are left out."""
    mesh.merge_close_vertices(1e-6)
    mesh.remove_degenerate_triangles()
    labels = np.asarray(mesh.cluster_connected_triangles()[0])
    vertices, triangles = np.asarray(mesh.vertices), np.asarray(mesh.triangles)
    found = []
    for label in range(int(labels.max()) + 1 if len(labels) else 0):
        used, own = np.unique(triangles[labels == label], return_inverse=True)
        points = np.array(vertices[used], dtype=np.float64)
        if (
            len(used) >= 4
            and np.linalg.svd(points[:, :2] - points[:, :2].mean(0))[1][1] > _THINNEST_M
        ):
            found.append(Solid(points, own.reshape(-1, 3).astype(np.int64), material))
    return found


def _read_urdf(path: Path) -> list[Any]:
    try:
        robot = ET.parse(path).getroot()
    except ET.ParseError as error:
        raise InputError(f"{path}: is no XML: {error}; a URDF was expected") from error
    if robot.tag != "robot":
        raise InputError(f"{path}: its root is <{robot.tag}>; a URDF begins with <robot>")
    parents = {
        _attribute(joint.find("child"), "link", path): (
            _attribute(joint.find("parent"), "link", path),
            _origin(joint),
        )
        for joint in robot.findall("joint")
    }
    meshes = []
    for link in robot.findall("link"):
        T = np.eye(4)
        name: str | None = link.get("name")
        seen: set[str] = set()
        while name in parents and name not in seen:
            seen.add(name)
            name, step = parents[name]
            T = step @ T
        for part in link.findall("visual") or link.findall("collision"):
            mesh = _geometry(part.find("geometry"), path)
            mesh.transform(T @ _origin(part))
            meshes.append(mesh)
    return meshes


def _geometry(geometry: ET.Element | None, path: Path) -> Any:
    """A shape of a URDF about its own origin."""
    o3d = _open3d()
    shape = next(iter(geometry), None) if geometry is not None else None
    if shape is None:
        raise InputError(f"{path}: a link has no <geometry>")
    make = o3d.geometry.TriangleMesh
    if shape.tag == "box":
        size = _numbers(shape, "size", 3, path)
        return make.create_box(*size).translate([-v / 2 for v in size])
    if shape.tag == "cylinder":
        (radius,), (length,) = (
            _numbers(shape, "radius", 1, path),
            _numbers(shape, "length", 1, path),
        )
        return make.create_cylinder(radius, length, 32, 1)
    if shape.tag == "sphere":
        return make.create_sphere(_numbers(shape, "radius", 1, path)[0], 12)
    if shape.tag == "mesh":
        name = _attribute(shape, "filename", path)
        plain = name.split("://")[-1]
        places = [path.parent / plain, path.parent / plain.split("/", 1)[-1]]
        mesh = _read_mesh(next((place for place in places if place.is_file()), places[0]))
        scale = _numbers(shape, "scale", 3, path) if shape.get("scale") else [1.0, 1.0, 1.0]
        mesh.transform(np.diag([*scale, 1.0]))
        return mesh
    raise InputError(
        f"{path}: geometry <{shape.tag}> is unknown; expected box, cylinder, sphere or mesh"
    )


def _origin(element: ET.Element) -> np.ndarray:
    T = np.eye(4)
    origin = element.find("origin")
    if origin is not None:
        rpy = [float(v) for v in (origin.get("rpy") or "0 0 0").split()]
        T[:3, :3] = Rotation.from_euler("xyz", rpy).as_matrix()
        T[:3, 3] = [float(v) for v in (origin.get("xyz") or "0 0 0").split()]
    return T


def _attribute(element: ET.Element | None, name: str, path: Path) -> str:
    value = None if element is None else element.get(name)
    if value is None:
        what = "an element" if element is None else f"<{element.tag}>"
        raise InputError(f"{path}: {what} lacks {name}")
    return value


def _numbers(element: ET.Element, name: str, count: int, path: Path) -> list[float]:
    words = _attribute(element, name, path).split()
    try:
        values = [float(word) for word in words]
    except ValueError as error:
        raise InputError(
            f"{path}: {name}={' '.join(words)!r} of <{element.tag}>: {error}"
        ) from error
    if len(values) != count:
        raise InputError(f"{path}: {name}={' '.join(words)!r} of <{element.tag}>: {count} expected")
    return values


def _open3d() -> Any:
    import open3d  # slow to import

    return open3d
