"""Masses of a described robot: what is rigidly joined to a link of the tree counts as one body.

Links of the file without `<inertial>` have no mass. Inertias that no body can have (eigenvalues that are zero, or one
larger than the sum of the others) are enlarged.

Source: the URDF specification of ROS; Featherstone 2008, chapter 2 (inertia about another point).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from perception.primitives.errors import InputError

from ..scenes import urdf_elements as elements
from .urdf import Merged

LEAST_M2 = 1e-4  # ours: least principal inertia of a kilogram, that of a ball of 16 mm


@dataclass(frozen=True, eq=False)
class Mass:
    """Mass of one link of a tree.

    Args:
        kg: Mass.
        centre: Its centre, frame of the link, m.
        inertia: About the centre, axes of the link, kg m^2.
    """

    kg: float
    centre: Float[np.ndarray, "3"]
    inertia: Float[np.ndarray, "3 3"]


def masses(model: Merged) -> tuple[Mass, ...]:
    """Masses of all links of the tree, base first.

    Raises:
        InputError: A link of the tree has no mass.
    """
    count = len(model.tree.joints) + 1
    kg, moment, about = np.zeros(count), np.zeros((count, 3)), np.zeros((count, 3, 3))
    for link in elements.root(model.path).findall("link"):
        inertial = link.find("inertial")
        if inertial is None:
            continue
        place = model.place(elements.attribute(link, "name", model.path))
        T = place.T_link_frame @ elements.origin(inertial, model.path)
        (mass,) = elements.numbers_of(inertial, "mass", ("value",), model.path)
        tensor = elements.numbers_of(inertial, "inertia", TENSOR, model.path)
        kg[place.link] += mass
        moment[place.link] += mass * T[:3, 3]
        about[place.link] += T[:3, :3] @ _symmetric(tensor) @ T[:3, :3].T + mass * _away(T[:3, 3])
    if not (kg > 0.0).all():
        raise InputError(
            f"{model.path}: link {int(np.argmin(kg))} of its tree has no mass; expected <inertial>"
        )
    centre = moment / kg[:, None]
    return tuple(
        Mass(float(m), c, _possible(tensor - m * _away(c), float(m)))
        for m, c, tensor in zip(kg, centre, about, strict=True)
    )


def efforts(model: Merged) -> dict[str, float]:
    """Torque limits of the joints of the tree by name, N m.

    Raises:
        InputError: A joint has none.
    """
    found = {}
    for joint in elements.root(model.path).findall("joint"):
        name, limit = elements.attribute(joint, "name", model.path), joint.find("limit")
        if limit is not None and limit.get("effort") is not None:
            (found[name],) = elements.numbers(limit, "effort", 1, model.path)
    for moved in model.tree.joints:
        if not found.get(moved.name, 0.0) > 0.0:
            raise InputError(
                f"{model.path}: joint {moved.name!r} has no torque limit; expected <limit effort=...>"
            )
    return {moved.name: found[moved.name] for moved in model.tree.joints}


TENSOR = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


def _symmetric(values: list[float]) -> Float[np.ndarray, "3 3"]:
    xx, xy, xz, yy, yz, zz = values
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _away(offset: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """Inertia of a unit mass at an offset."""
    return np.asarray(offset @ offset * np.eye(3) - np.outer(offset, offset))


def _possible(inertia: Float[np.ndarray, "3 3"], kg: float) -> Float[np.ndarray, "3 3"]:
    """The nearest larger inertia that a body of this mass can have."""
    values, axes = np.linalg.eigh(inertia)
    values = np.maximum(values, LEAST_M2 * kg)
    short = values[2] - values[0] - values[1]
    values[:2] += max(short, 0.0) / 2
    return np.asarray((axes * values) @ axes.T)
