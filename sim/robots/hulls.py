"""The links of a URDF as convex solids: the hull of each visual geometry, with few corners.

The cameras see these hulls, and the self-filter removes them. A hull is reduced to the corners that lie farthest in evenly
spaced directions; it is then smaller by at most what `Hull.cut_m` says.

Source: Barber et al. 1996 (Quickhull); González 2010 (Fibonacci lattice); reading Collada by its specification 1.4.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import ConvexHull, QhullError
from scipy.spatial.transform import Rotation

from perception.primitives import mesh_reader, safe_input
from perception.primitives.errors import InputError
from perception.primitives.mesh_reader import MeshError
from perception.primitives.safe_input import UnreadableError

from ..scenes import urdf_elements as elements
from ..scenes.model_files import MESHES

DIRECTIONS = 80  # ours: hulls keep at most as many corners; a hand of 20 cm is then smaller by 2 mm
ROUND = 24  # ours: corners of a circle
BALL = 1000  # ours: of a sphere, before its hull is reduced
COLLADA = "{http://www.collada.org/2005/11/COLLADASchema}"


@dataclass(frozen=True, eq=False)
class Hull:
    """A convex solid.

    Args:
        name: Of the link in the URDF, and a number.
        link: Number of the link of the tree.
        corners: In the frame of that link, m.
        triangles: Indices of corners, counter-clockwise from outside.
        cut_m: Greatest distance by which the shape reaches out of it.
    """

    name: str
    link: int
    corners: Float[np.ndarray, "n 3"]
    triangles: Int[np.ndarray, "m 3"]
    cut_m: float


def hull_of(name: str, link: int, points: Float[np.ndarray, "n 3"]) -> Hull | None:
    """The reduced convex hull of points; None where they have no volume."""
    try:
        whole = ConvexHull(points)
    except (QhullError, ValueError):
        return None
    rim = points[whole.vertices]
    kept = np.unique(np.argmax(rim @ _directions(DIRECTIONS).T, axis=0))
    try:
        small = ConvexHull(rim[kept])
    except QhullError:
        return None
    corners = rim[kept][small.vertices]
    faces = np.searchsorted(small.vertices, small.simplices)
    a, b, c = (corners[faces[:, k]] for k in range(3))
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), small.equations[:, :3]) < 0.0
    faces[inward] = faces[inward][:, ::-1]
    outside = rim @ small.equations[:, :3].T + small.equations[:, 3]
    return Hull(name, link, corners, faces.astype(np.int64), max(0.0, float(outside.max())))


def points_of(shape: ET.Element, path: Path) -> Float[np.ndarray, "n 3"]:
    """Points whose convex hull contains a <visual> or <collision>, in the frame of its link, m.

    Args:
        shape: The element.
        path: Of the URDF.

    Raises:
        InputError: It has no geometry, of an unknown kind, or its file cannot be read.
    """
    holder = shape.find("geometry")
    geometry = next(iter(holder), None) if holder is not None else None
    if geometry is None:
        raise InputError(f"{path}: a link has no <geometry>")
    if geometry.tag == "box":
        half = np.array(elements.numbers(geometry, "size", 3, path, positive=True)) / 2
        points = half * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    elif geometry.tag == "cylinder":
        (radius,) = elements.numbers(geometry, "radius", 1, path, positive=True)
        (length,) = elements.numbers(geometry, "length", 1, path, positive=True)
        angle = np.arange(ROUND) * 2 * math.pi / ROUND
        ring = radius / math.cos(math.pi / ROUND) * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        points = np.concatenate([np.c_[ring, np.full(ROUND, z)] for z in (-length / 2, length / 2)])
    elif geometry.tag == "sphere":
        points = elements.numbers(geometry, "radius", 1, path, positive=True)[0] * _ball()
    elif geometry.tag == "mesh":
        points = _mesh_points(geometry, path)
    else:
        raise InputError(
            f"{path}: geometry <{geometry.tag}> is unknown; expected box, cylinder, sphere or mesh"
        )
    T = elements.origin(shape, path)
    return np.asarray(points @ T[:3, :3].T + T[:3, 3])


def _mesh_points(geometry: ET.Element, path: Path) -> Float[np.ndarray, "n 3"]:
    file = elements.referenced(elements.attribute(geometry, "filename", path), path)
    kind = file.suffix.lower()
    scale = np.array(elements.numbers(geometry, "scale", 3, path, "1 1 1"))
    if kind == ".dae":
        return collada_points(file) * scale
    if kind not in MESHES:
        raise InputError(
            f"{file}: a mesh of kind {kind or 'unknown'} is not read; expected {', '.join(MESHES)} or .dae"
        )
    try:
        return np.asarray(mesh_reader.read(file).vertices * scale)
    except MeshError as error:
        raise InputError(f"{file}: {error}") from error


def collada_points(path: Path) -> Float[np.ndarray, "n 3"]:
    """Vertices of all meshes of a Collada file where its scene places them, m.

    A file whose y axis points up is turned so that z does, as viewers of URDFs do.

    Raises:
        InputError: The file cannot be read, or holds no vertices.
    """
    try:
        root = ET.fromstring(safe_input.data(path, safe_input.MOST_TEXT_BYTES))
        unit = root.find(f"{COLLADA}asset/{COLLADA}unit")
        metre = 1.0 if unit is None else float(unit.get("meter", "1"))
        meshes = {
            geometry.get("id", ""): _positions(geometry)
            for geometry in root.iter(f"{COLLADA}geometry")
        }
        found: list[np.ndarray] = []
        for scene in root.iter(f"{COLLADA}visual_scene"):
            _collect(scene, np.eye(4), meshes, found)
    except UnreadableError as error:
        raise InputError(f"{path}: {error}; expected a Collada mesh") from error
    except (ET.ParseError, LookupError, ValueError) as error:
        raise InputError(f"{path}: not a Collada mesh: {error}") from error
    points = metre * np.concatenate(found) if found else np.zeros((0, 3))
    if root.findtext(f"{COLLADA}asset/{COLLADA}up_axis", "Y_UP").strip() == "Y_UP":
        points = points[:, [0, 2, 1]] * np.array([1.0, -1.0, 1.0])
    if not len(points) or not np.isfinite(points).all():
        raise InputError(f"{path}: holds {len(points)} vertices; expected finite ones in its scene")
    return points


def _positions(geometry: ET.Element) -> Float[np.ndarray, "n 3"]:
    """Vertices of a mesh: the sources that its <vertices> names as POSITION."""
    wanted = {
        use.get("source", "")[1:]
        for use in geometry.iterfind(f".//{COLLADA}vertices/{COLLADA}input")
        if use.get("semantic") == "POSITION"
    }
    texts = [
        source.findtext(f"{COLLADA}float_array") or ""
        for source in geometry.iter(f"{COLLADA}source")
        if source.get("id") in wanted
    ]
    return np.array([float(word) for text in texts for word in text.split()]).reshape(-1, 3)


def _collect(
    node: ET.Element, T: np.ndarray, meshes: dict[str, np.ndarray], found: list[np.ndarray]
) -> None:
    """Vertices of a node and of those below it."""
    for child in node:
        values = [float(word) for word in (child.text or "").split()] if not len(child) else []
        if child.tag == f"{COLLADA}matrix":
            T = T @ np.array(values).reshape(4, 4)
        elif child.tag == f"{COLLADA}translate":
            T = T @ np.block([[np.eye(3), np.array(values)[:, None]], [np.array([[0, 0, 0, 1.0]])]])
        elif child.tag == f"{COLLADA}scale":
            T = T @ np.diag([*values, 1.0])
        elif child.tag == f"{COLLADA}rotate":
            T = T @ _turn(values)
        elif child.tag == f"{COLLADA}instance_geometry":
            points = meshes[child.get("url", "")[1:]]
            found.append(points @ T[:3, :3].T + T[:3, 3])
        elif child.tag == f"{COLLADA}node":
            _collect(child, T, meshes, found)


def _turn(values: list[float]) -> Float[np.ndarray, "4 4"]:
    """A rotation about an axis, by deg, as <rotate> has it."""
    axis = np.array(values[:3])
    if len(values) != 4 or not np.linalg.norm(axis) > 0.0:
        raise ValueError(f"<rotate> has {values}; expected an axis and an angle in deg")
    T = np.eye(4)
    turned = math.radians(values[3]) * axis / np.linalg.norm(axis)
    T[:3, :3] = Rotation.from_rotvec(turned).as_matrix()
    return T


@cache
def _ball() -> Float[np.ndarray, "n 3"]:
    """Points whose convex hull just contains the unit ball."""
    points = _directions(BALL)
    return np.asarray(points / -ConvexHull(points).equations[:, 3].max())


@cache
def _directions(count: int) -> Float[np.ndarray, "n 3"]:
    """That many evenly spaced unit vectors, the six axes among them."""
    k = np.arange(count - 6) + 0.5
    z = 1.0 - 2.0 * k / (count - 6)
    turn = math.pi * (1.0 + math.sqrt(5.0)) * k
    flat = np.sqrt(1.0 - z * z)
    ball = np.stack([flat * np.cos(turn), flat * np.sin(turn), z], axis=1)
    return np.concatenate([ball, np.eye(3), -np.eye(3)])
