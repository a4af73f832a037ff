"""The coloured cloud of a run: the mean point and colour of each voxel.

Memory is bounded: when the number of voxels reaches its limit, their size doubles and the cloud is thinned in place.
Only writing PLY files needs Open3D.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int, UInt8

from perception.primitives.errors import ConfigError, InputError, OutputError
from perception.primitives.safe_input import UnreadableError
from perception.primitives.settings import setting

from .. import open3d_objects
from . import _voxel_kernels, ply
from .atomic_write import atomic_path

logger = logging.getLogger(__name__)

FIRST_CAPACITY = 1 << 14  # voxels
FINEST_M = 0.001  # ours: of a voxel; a finer grid only fills the memory
MOST_M = 2e4  # ours: of a coordinate that is read; given poses are at most half as far away


@dataclass(frozen=True)
class CloudConfig:
    """Resolution and largest size of a cloud."""

    voxel_m: float = setting(
        0.02, "m", "side of a voxel of the cloud", "ours: depth noise of the cameras at 2 m"
    )
    most_voxels: int = setting(
        1_000_000,
        "",
        "number of voxels at which their size doubles",
        "ours: 100 MB in memory, 27 MB as a file",
    )

    def __post_init__(self) -> None:
        if not self.voxel_m >= FINEST_M:
            raise ConfigError(f"cloud: voxel_m={self.voxel_m} must be at least {FINEST_M} m")
        if self.most_voxels < 8:
            raise ConfigError(f"cloud: most_voxels={self.most_voxels} must be at least 8")


class CloudBuilder:
    """Averages points per voxel; voxels are ordered by their first hit."""

    def __init__(self, config: CloudConfig | None = None, values: int = 0) -> None:
        """An empty cloud, which averages this many further numbers per voxel."""
        self._values = values
        self.config = config or CloudConfig()
        self.voxel_m = self.config.voxel_m  # grows when the voxels run out
        self._coloured = False
        self._calls = 0
        self._used = 0
        self._allocate(min(FIRST_CAPACITY, self.config.most_voxels))

    def __len__(self) -> int:
        """Voxels in use."""
        return self._used

    def add(
        self,
        points_world: Float[np.ndarray, "n 3"],
        colours: UInt8[np.ndarray, "n 3"] | None = None,
        values: Float[np.ndarray, "n k"] | None = None,
    ) -> None:
        """Add the points of one frame, world frame, m, with their colours, RGB, and further numbers.

        Points that are NaN are ignored.

        Raises:
            InputError: The number of colours or values differs from the number of points.
        """
        if (0 if values is None else values.shape[1]) != self._values or (
            values is not None and len(values) != len(points_world)
        ):
            shape = None if values is None else values.shape
            raise InputError(
                f"cloud: values of shape {shape} for {len(points_world)} points; expected "
                f"{self._values} a point"
            )
        if colours is not None and len(colours) != len(points_world):
            raise InputError(
                f"cloud: {len(points_world)} points but {len(colours)} colours; give one a point"
            )
        self._coloured = self._coloured or colours is not None
        tints = np.zeros((0, 3), np.uint8) if colours is None else np.ascontiguousarray(colours)
        points = np.ascontiguousarray(points_world)
        numbers = np.zeros((len(points), 0)) if values is None else np.ascontiguousarray(values)
        done = 0
        while done < len(points):
            done, self._used = _voxel_kernels.add_to_voxels(
                points,
                tints,
                numbers,
                1.0 / self.voxel_m,
                self._calls,
                done,
                self._used,
                self._keys,
                self._table,
                self._sums,
                self._counts,
                self._hits,
                self._last,
            )
            if done < len(points):
                self._make_room()
        self._calls += 1

    def cloud(self) -> tuple[Float[np.ndarray, "n 3"], UInt8[np.ndarray, "n 3"] | None]:
        """Mean point of each voxel, world frame, m, and its mean colour; None without colours."""
        counts = self._counts[: self._used, np.newaxis]
        means = self._sums[: self._used] / counts
        colours = np.rint(means[:, 3:6]).astype(np.uint8) if self._coloured else None
        return means[:, :3].copy(), colours

    def to_open3d(self) -> Any:
        """The cloud as an `open3d.t.geometry.PointCloud`, with the number of `sightings` of each point."""
        points, colours = self.cloud()
        return open3d_objects.point_cloud(points, colours, {"sightings": self.sightings})

    @property
    def values(self) -> Float[np.ndarray, "n k"]:
        """Means of the further numbers of each voxel, in the order of `cloud`."""
        return np.asarray(self._sums[: self._used, 6:] / self._counts[: self._used, np.newaxis])

    @property
    def sightings(self) -> Int[np.ndarray, "n"]:
        """Number of frames (calls of `add`) that hit each voxel, in the order of `cloud`."""
        return self._hits[: self._used].copy()

    def _allocate(self, capacity: int) -> None:
        self._keys = np.zeros(capacity, np.int64)
        self._sums = np.zeros((capacity, 6 + self._values))
        self._counts = np.zeros(capacity, np.int64)
        self._hits = np.zeros(capacity, np.int64)
        self._last = np.full(capacity, -1, np.int64)
        self._table = np.full(1 << (2 * capacity - 1).bit_length(), -1, np.int64)

    def _make_room(self) -> None:
        """Double the number of voxels; at the limit, double their size instead."""
        used, capacity = self._used, min(2 * len(self._keys), self.config.most_voxels)
        if capacity > used:
            old = (self._keys, self._sums, self._counts, self._hits, self._last)
            self._allocate(capacity)
            new = (self._keys, self._sums, self._counts, self._hits, self._last)
            for target, source in zip(new, old, strict=True):
                target[:used] = source[:used]
            _voxel_kernels.rebuild_table(self._keys, used, self._table)
            return
        self.voxel_m *= 2
        logger.warning("cloud: %d voxels in use, thinned to %g m", used, self.voxel_m)
        self._used = _voxel_kernels.thin(
            self.voxel_m,
            used,
            self._keys,
            self._table,
            self._sums,
            self._counts,
            self._hits,
            self._last,
        )


def save_ply(
    path: str | Path,
    points: Float[np.ndarray, "n 3"],
    colours: UInt8[np.ndarray, "n 3"] | None = None,
    attributes: Mapping[str, np.ndarray] | None = None,
) -> None:
    """Write a binary PLY, complete or absent.

    Args:
        path: File name that ends in .ply.
        points: At least one, m.
        colours: RGB; None writes none.
        attributes: Further numbers per point, as for `open3d_objects.point_cloud`.

    Raises:
        OutputError: It cannot be written, or Open3D cannot be loaded.
    """
    try:
        open3d = _open3d()
        cloud = open3d_objects.point_cloud(points, colours, attributes)
    except ImportError as error:
        raise OutputError(f"cannot write {path}: {_LIBRARIES} ({error})") from error
    with atomic_path(path) as temporary:
        if not open3d.t.io.write_point_cloud(str(temporary), cloud):
            raise OutputError(
                f"cannot write {path}: Open3D refused {len(points)} points; expected at least one, a path "
                "ending in .ply and room on the disk"
            )


def load_ply(
    path: str | Path,
) -> tuple[Float[np.ndarray, "n 3"], UInt8[np.ndarray, "n 3"] | None]:
    """Finite points of a cloud that `save_ply` wrote, m, and their colours, RGB, or None.

    Raises:
        InputError: The file is missing, damaged or empty.
    """
    try:
        found = ply.read_points(path)
    except UnreadableError as error:
        raise InputError(f"cloud {path} {error}; a PLY of a run was expected") from error
    points = np.stack([found[axis].astype(np.float64) for axis in "xyz"], axis=-1)
    usable = (np.abs(points) <= MOST_M).all(axis=1)
    if not usable.any():
        raise InputError(f"cloud {path} holds no points within {MOST_M:g} m of its origin")
    if not all(
        name in (found.dtype.names or ()) and found[name].dtype == np.uint8 for name in _RGB
    ):
        return points[usable], None
    return points[usable], np.stack([found[name][usable] for name in _RGB], axis=-1)


_RGB = ("red", "green", "blue")
_LIBRARIES = (
    "Open3D cannot be loaded; on Debian or Ubuntu: "
    "apt-get install --no-install-recommends libegl1 libgl1 libx11-6 libusb-1.0-0"
)


def _open3d() -> Any:
    """Open3D, imported on use: it takes a second."""
    import open3d

    return open3d
