"""Our surface map beside Open3D's VoxelBlockGrid, each tuned: accuracy, completeness and time on the same frames.

The truncation distance (2, 3, 4, 6 or 8 voxels), Open3D's block, least weight and principal point were chosen by the
F-score at 2 cm on the first half of the trajectory through Replica's office, with the noise of seed 100; the second half
is reported, with other noise. Voxels of 2 cm, poses and frames are the same. Open3D weighs all pixels
equally; ours also runs so, which shows what the weights by variance of depth bring.

Source: ours; Dong et al. 2021 (VoxelBlockGrid).
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
from jaxtyping import UInt8

from mapping.surface.surface_map import surface_map
from mapping.surface.tsdf import UNIT_SIGMA_M
from mapping.surface.tsdf_config import SurfaceMap, TsdfConfig
from perception.primitives.frame import Depth
from perception.primitives.pose import Pose3

from ..support import real_data
from ..support.experiment import Part, Say
from .odometry import depth_and_colour
from .replica_room import ReplicaRoom
from .surface_quality import Quality, quality

EVERY = 8  # of Replica's poses
BAND_VOXELS = 3.0
"""Truncation of the TSDF; good for both: F score of ours .9775 (2 and 4 voxels: .975), of Open3D .983 (.984, .979)."""
WARM = 3  # frames before time counts
EQUAL = "ours, equal weights"
METHODS = {"ours": "half_ours", EQUAL: "half_equal", "VoxelBlockGrid": "half_open3d"}
"""Name to the beginning of its figures."""


class Timed:
    """A surface map, and the processor time of its images."""

    def __init__(self, surface: SurfaceMap, equal: bool = False) -> None:
        self.surface = surface
        self._equal = equal
        self._spent: list[float] = []

    def add(self, depth: Depth, pose: Pose3, rgb: UInt8[np.ndarray, "h w 3"] | None) -> None:
        """Fuse one image, if asked to with the same weight for every pixel."""
        if self._equal:
            depth = replace(depth, sigma=np.full_like(depth.z, UNIT_SIGMA_M))
        begun = time.process_time()
        self.surface.integrate(depth, pose, rgb)
        self._spent.append(time.process_time() - begun)

    @property
    def ms(self) -> float:
        """Median over the images but the first."""
        return 1e3 * float(np.median(self._spent[WARM:]))


def peers(seeds: int, say: Say) -> Part:
    """The second half of the trajectory, once per seed; the worst of the seeds is the figure."""
    found: dict[str, list[tuple[Quality, float]]] = {name: [] for name in METHODS}
    for seed in range(seeds):
        say(f"office: seed {seed}, our surface beside Open3D's")
        room = ReplicaRoom(real_data.folder("replica_office0"))
        maps = {name: _map(name) for name in METHODS}
        rng = np.random.default_rng(seed)
        for frame in room.frames(rng, EVERY, len(room.poses) // 2):
            depth, rgb = depth_and_colour(frame)
            assert frame.T_world_camera is not None
            for one in maps.values():
                one.add(depth, frame.T_world_camera, rgb)
        for name, one in maps.items():
            judged = quality(one.surface.mesh(), room, np.random.default_rng(seed))
            found[name].append((judged, one.ms))
    figures: dict[str, float] = {}
    rows = []
    for name, key in METHODS.items():
        ms = [spent for _, spent in found[name]]
        accuracy = max(one.accuracy_mm for one, _ in found[name])
        complete = min(one.completeness_5cm for one, _ in found[name])
        fscore = min(one.fscore_2cm for one, _ in found[name])
        figures |= {
            f"{key}_accuracy_mm": accuracy,
            f"{key}_completeness_5cm": complete,
            f"{key}_fscore_2cm": fscore,
            f"{key}_ms": float(np.median(ms)),
        }
        rows.append(
            f"second half, {name:<20} accuracy {accuracy:5.2f} mm   complete in 5 cm {complete:.4f}   "
            f"F at 2 cm {fscore:.4f}   {figures[f'{key}_ms']:5.1f} ms an image"
        )
    return figures, rows


def _map(name: str) -> Timed:
    method = "open3d" if name == "VoxelBlockGrid" else "compiled"
    return Timed(
        surface_map(TsdfConfig(method=method, band_voxels=BAND_VOXELS)), equal=name == EQUAL
    )
