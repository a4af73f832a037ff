"""Elements of a URDF file: its root, attributes, numbers, placements and the files that it references.

Shared by URDFs that stand in a scene (`model_files`) and by those that walk (`sim.robots`). The file is read within
limits; an error names the file, the element and what was expected.
"""

from __future__ import annotations

import os
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from perception.primitives import safe_input
from perception.primitives.errors import InputError
from perception.primitives.safe_input import UnreadableError

MOST_M = 1000.0  # ours: of a number in a URDF
ABOVE = 6  # ours: folders above a URDF in which a mesh of its package is looked for


def root(path: Path) -> ET.Element:
    """The element <robot> of a URDF.

    Raises:
        InputError: The file is missing, too large, not XML, or no URDF.
    """
    try:
        robot = ET.fromstring(safe_input.data(path, safe_input.MOST_TEXT_BYTES))
    except UnreadableError as error:
        raise InputError(f"{path}: {error}; expected a URDF") from error
    except (ET.ParseError, LookupError, ValueError) as error:  # also of an unknown encoding
        raise InputError(f"{path}: not valid XML: {error}; expected a URDF") from error
    if robot.tag != "robot":
        raise InputError(f"{path}: its root is <{robot.tag}>; a URDF begins with <robot>")
    return robot


def referenced(name: str, path: Path) -> Path:
    """The file that a URDF references: beside it, or in the package that contains it.

    Args:
        name: As written, with or without package://PACKAGE/.
        path: Of the URDF.

    Raises:
        InputError: There is no such file.
    """
    plain = name.split("://")[-1]
    beside = [path.parent / plain, path.parent / plain.split("/", 1)[-1]]
    above = [up / plain.split("/", 1)[-1] for up in list(path.parents)[1:ABOVE]]
    file = next((place for place in beside + above if os.path.isfile(place)), None)
    if file is None:
        looked = " and ".join(dict.fromkeys(str(place) for place in beside))
        raise InputError(
            f"{path}: filename={name!r} of <mesh>: no such file; looked for {looked}, put it there"
        )
    return file


def origin(element: ET.Element, path: Path) -> Float[np.ndarray, "4 4"]:
    """The placement of an element in its parent; the identity where it has none."""
    T = np.eye(4)
    placed = element.find("origin")
    if placed is not None:
        rpy = numbers(placed, "rpy", 3, path, "0 0 0")
        T[:3, :3] = Rotation.from_euler("xyz", rpy).as_matrix()
        T[:3, 3] = numbers(placed, "xyz", 3, path, "0 0 0")
    return T


def attribute(element: ET.Element | None, name: str, path: Path) -> str:
    """An attribute that must be there."""
    value = None if element is None else element.get(name)
    if value is None:
        what = "an element" if element is None else f"<{element.tag}>"
        raise InputError(f"{path}: {what} lacks {name}")
    return value


def numbers(
    element: ET.Element,
    name: str,
    count: int,
    path: Path,
    default: str = "",
    positive: bool = False,
) -> list[float]:
    """A number of finite values from an attribute, m or rad; positive ones for sizes."""
    text = (element.get(name) or default) if default else attribute(element, name, path)
    kind = "positive number" if positive else "number"
    expected = f"expected {count} {kind}{'s' if count > 1 else ''}"
    try:
        values = [float(word) for word in text.split()]
    except ValueError as error:
        raise InputError(
            f"{path}: {name}={text!r} of <{element.tag}>: {error}; {expected}"
        ) from error
    good = all(abs(value) <= MOST_M and (value > 0.0 or not positive) for value in values)
    if len(values) != count or not good:
        raise InputError(
            f"{path}: {name}={text!r} of <{element.tag}>: {expected}, none beyond {MOST_M:g}"
        )
    return values


def numbers_of(parent: ET.Element, tag: str, names: tuple[str, ...], path: Path) -> list[float]:
    """A number from each of these attributes of a child that must be there."""
    child = parent.find(tag)
    if child is None:
        raise InputError(f"{path}: <{parent.tag}> lacks <{tag}>")
    return [numbers(child, name, 1, path)[0] for name in names]
