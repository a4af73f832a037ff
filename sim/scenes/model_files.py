"""Models from files as solids: meshes (OBJ, STL, PLY, glTF) and URDF files.

A glTF is rotated from its y up to our z up; for other meshes the user states the axis. A sheet without thickness
becomes a board, so that it is visible from both sides and solid. Links of a URDF are placed with all joints at zero;
their visual geometry is used, or else their collision geometry.
"""

from __future__ import annotations

import dataclasses
import math
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from perception.primitives import mesh_reader
from perception.primitives.errors import InputError
from perception.primitives.mesh_reader import MeshError

from ..rendering.rays import open3d_library
from ..shapes import Solid
from . import urdf_elements
from .urdf_elements import attribute, numbers, origin

MESHES = (".obj", ".stl", ".ply", ".off", ".gltf", ".glb")
MOST_TRIANGLES = 50_000  # ours: rendering and ray casting stay fast
SHEET_M = 0.01  # ours: thickness given to a sheet
_THINNEST_M = 1e-4
_Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])  # y to z, z to -y


def read_model(
    path: Path, material: str = "plaster/grey", scale: float = 1.0, up: str = ""
) -> tuple[Solid, ...]:
    """Solids of a model about its own origin, z up, m; one for each connected component.

    Args:
        path: Mesh or URDF.
        material: Its material.
        scale: Metres per unit of the file.
        up: Axis of the file that points up, "y" or "z"; empty: y for glTF (by its standard), else z.

    Raises:
        InputError: Missing, of another format, empty or too large; a URDF that is not z up.
    """
    if not path.is_file():
        raise InputError(
            f"{path}: no such file; a mesh ({', '.join(MESHES)}) or a .urdf was expected"
        )
    if path.suffix.lower() == ".urdf":
        if up not in ("", "z"):
            raise InputError(f"{path}: up = {up!r}; a URDF is z up, leave it out")
        meshes = _read_urdf(path)
    elif path.suffix.lower() in MESHES:
        mesh = _read_mesh(path)
        if (up or ("y" if path.suffix.lower() in (".gltf", ".glb") else "z")) == "y":
            mesh.rotate(_Y_UP, center=(0.0, 0.0, 0.0))
        meshes = [mesh]
    else:
        raise InputError(
            f"{path}: a model of kind {path.suffix or 'unknown'} is not read; expected "
            f"{', '.join(MESHES)} or .urdf"
        )
    for mesh in meshes:
        mesh.scale(scale, center=(0.0, 0.0, 0.0))
    count = sum(len(mesh.triangles) for mesh in meshes)
    if count > MOST_TRIANGLES:
        raise InputError(
            f"{path}: {count} triangles; at most {MOST_TRIANGLES} are allowed, simplify the mesh"
        )
    solids = tuple(solid for mesh in meshes for solid in _pieces(mesh, material))
    if not solids:
        raise InputError(
            f"{path}: has no surface wider than {1e3 * _THINNEST_M:g} mm; check its unit and scale"
        )
    return solids


def placed(
    solids: tuple[Solid, ...], at: tuple[float, float, float], yaw_rad: float
) -> tuple[Solid, ...]:
    """The solids rotated about the vertical and moved."""
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return tuple(
        dataclasses.replace(one, vertices=one.vertices @ R.T + np.array(at)) for one in solids
    )


def _read_mesh(path: Path) -> Any:
    o3d = open3d_library()
    try:
        found = mesh_reader.read(path)
    except MeshError as error:
        raise InputError(f"{path}: {error}") from error
    if not len(found.triangles):
        raise InputError(f"{path}: has no triangles that Open3D can read")
    return o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(found.vertices), o3d.utility.Vector3iVector(found.triangles)
    )


def _pieces(mesh: Any, material: str) -> list[Solid]:
    """One solid per connected component; sheets are thickened, slivers without width left out."""
    mesh.merge_close_vertices(1e-6)
    mesh.remove_degenerate_triangles()
    labels = np.asarray(mesh.cluster_connected_triangles()[0])
    vertices, triangles = np.asarray(mesh.vertices), np.asarray(mesh.triangles)
    found = []
    for label in range(int(labels.max()) + 1 if len(labels) else 0):
        used, own = np.unique(triangles[labels == label], return_inverse=True)
        points = np.array(vertices[used], dtype=np.float64)
        faces = own.reshape(-1, 3).astype(np.int64)
        axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2]
        _, width, thickness = np.ptp(points @ axes.T, axis=0)
        if width < _THINNEST_M:
            continue
        if thickness < _THINNEST_M:
            points, faces = _thickened(points, faces, axes[2])
        found.append(Solid(points, faces, material))
    return found


def _thickened(
    points: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "m 3"], normal: Float[np.ndarray, "3"]
) -> tuple[Float[np.ndarray, "k 3"], Int[np.ndarray, "l 3"]]:
    """A flat sheet made a board: one face above, one below, and a rim along its open edges."""
    flat = points - ((points - points.mean(axis=0)) @ normal)[:, None] * normal
    _, kept, merged = np.unique(
        np.rint(flat / _THINNEST_M), axis=0, return_index=True, return_inverse=True
    )
    flat, faces = flat[kept], merged.reshape(-1)[faces]
    a, b, c = (flat[faces[:, k]] for k in range(3))
    facing = np.cross(b - a, c - a) @ normal
    upwards = np.where((facing > 0.0)[:, None], faces, faces[:, ::-1])[np.abs(facing) > 1e-12]
    # faces drawn once for each side count once
    _, single = np.unique(np.sort(upwards, axis=1), axis=0, return_index=True)
    top = upwards[single]
    edges = np.concatenate([top[:, [0, 1]], top[:, [1, 2]], top[:, [2, 0]]])
    known = set(map(tuple, edges.tolist()))
    open_edges = [(i, j) for i, j in known if (j, i) not in known]
    count = len(flat)
    rim = [
        triangle
        for i, j in sorted(open_edges)
        for triangle in ((i + count, j + count, j), (i + count, j, i))
    ]
    half = SHEET_M / 2 * normal
    return (
        np.concatenate([flat + half, flat - half]),
        np.concatenate([top, top[:, ::-1] + count, np.array(rim, dtype=np.int64).reshape(-1, 3)]),
    )


def _read_urdf(path: Path) -> list[Any]:
    robot = urdf_elements.root(path)
    parents = {
        attribute(joint.find("child"), "link", path): (
            attribute(joint.find("parent"), "link", path),
            origin(joint, path),
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
            mesh.transform(T @ origin(part, path))
            meshes.append(mesh)
    return meshes


def _geometry(geometry: ET.Element | None, path: Path) -> Any:
    """A URDF shape about its own origin."""
    shape = next(iter(geometry), None) if geometry is not None else None
    if shape is None:
        raise InputError(f"{path}: a link has no <geometry>")
    make = open3d_library().geometry.TriangleMesh
    if shape.tag == "box":
        size = numbers(shape, "size", 3, path, positive=True)
        return make.create_box(*size).translate([-v / 2 for v in size])
    if shape.tag == "cylinder":
        (radius,) = numbers(shape, "radius", 1, path, positive=True)
        (length,) = numbers(shape, "length", 1, path, positive=True)
        return make.create_cylinder(radius, length, 32, 1)
    if shape.tag == "sphere":
        return make.create_sphere(*numbers(shape, "radius", 1, path, positive=True), 12)
    if shape.tag == "mesh":
        return _referenced(shape, path)
    raise InputError(
        f"{path}: geometry <{shape.tag}> is unknown; expected box, cylinder, sphere or mesh"
    )


def _referenced(shape: ET.Element, path: Path) -> Any:
    """The mesh that a URDF references, in its own frame; the URDF places it in the link."""
    name = attribute(shape, "filename", path)
    file = urdf_elements.referenced(name, path)
    if file.suffix.lower() not in MESHES:
        raise InputError(
            f"{path}: filename={name!r} of <mesh>: {file.suffix or 'its kind'} is not read; expected "
            f"{', '.join(MESHES)}, convert it"
        )
    mesh = _read_mesh(file)
    scale = numbers(shape, "scale", 3, path, "1 1 1")
    if 0.0 in scale:
        raise InputError(f"{path}: scale={shape.get('scale')!r} of <mesh>: must not be 0")
    mesh.transform(np.diag([*scale, 1.0]))
    if math.prod(scale) < 0.0:  # a mirrored mesh needs its faces reversed
        triangles = np.asarray(mesh.triangles)
        triangles[:] = triangles[:, ::-1].copy()
    return mesh
