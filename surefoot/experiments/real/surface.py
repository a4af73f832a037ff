"""Surface maps and traversable floor of real places, with true poses and with poses by odometry.

Replica's office: the mesh from noisy ray cast depth, compared with the visible part of the true mesh. TUM's cabinet:
a floor with one box on it, recorded around the box, without given poses. The probability map and the kitchen:
see `probability_map`; our surface map beside Open3D's: `surface_peers`.

Source: ours.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from mapping.surface.surface_map import surface_map
from mapping.surface.traversability import traversability
from mapping.surface.tsdf import Tsdf
from mapping.surface.tsdf_config import SurfaceMap
from perception.depth import structured_light
from perception.odometry.rgbd_odometry import Odometer
from perception.primitives.pose import Pose3

from ...evaluation.metrics.trajectory import Alignment, align
from ...recordings.open import open_recording
from ..support import real_data
from ..support.experiment import Experiment, Outcome, Say, Target, combined
from .odometry import depth_and_colour, without_poses
from .probability_map import kitchen, probabilities
from .replica_room import ReplicaRoom
from .surface_peers import peers
from .surface_quality import Quality, quality

EVERY = 8  # of Replica's 2000 frames: each surface is still seen about twenty times
CLEAR_M = 0.08  # a foot: closer to the cabinet the robot cannot stand


def office(seeds: int, say: Say) -> tuple[dict[str, float], list[str]]:
    """Replica's office with true poses and with ours."""
    room = ReplicaRoom(real_data.folder("replica_office0"))
    worst: dict[str, list[Quality]] = {"true poses": [], "our poses": []}
    rows = []
    for seed in range(seeds):
        maps = {"true poses": surface_map()}
        odometer = Odometer(np.random.default_rng(seed))
        say(f"office: seed {seed}, odometry and maps by true poses")
        true = []
        for frame, pose in without_poses(room.frames(np.random.default_rng(seed), EVERY)):
            odometer.track(frame)
            true.append(pose)
            fuse(maps["true poses"], frame, pose)
        say(f"office: seed {seed}, map by our poses")
        poses, _ = odometer.trajectory()
        own = maps["our poses"] = surface_map()
        alignment = rigid_alignment(poses, true)
        turn = Pose3.from_rotation(alignment.rotation, alignment.translation)
        again = without_poses(room.frames(np.random.default_rng(seed), EVERY))
        for (frame, _), pose in zip(again, poses, strict=True):
            fuse(own, frame, turn @ pose)
        for name, one in maps.items():
            found = quality(one.mesh(), room, np.random.default_rng(seed))
            worst[name].append(found)
            rows.append(
                f"office, {name:<15} accuracy {found.accuracy_mm:5.2f} mm   complete in 5 cm "
                f"{found.completeness_5cm:.4f}   F at 2 cm {found.fscore_2cm:.4f}"
            )
    return office_figures(worst), rows


def office_figures(worst: dict[str, list[Quality]]) -> dict[str, float]:
    """Figures of the worst seed."""
    figures = {}
    keys = {"true poses": "_true_poses", "our poses": ""}
    for name, key in keys.items():
        found = worst[name]
        figures[f"accuracy{key}_mm"] = max(one.accuracy_mm for one in found)
        figures[f"completeness{key}_5cm"] = min(one.completeness_5cm for one in found)
        figures[f"fscore{key}_2cm"] = min(one.fscore_2cm for one in found)
    return figures


def fuse(surface: SurfaceMap, frame: Any, pose: Pose3) -> None:
    """Integrate one frame into a map."""
    depth, rgb = depth_and_colour(frame)
    surface.integrate(depth, pose, rgb)


def rigid_alignment(poses: list[Pose3], true: list[Pose3]) -> Alignment:
    """The rigid motion from our map frame to the true one."""
    alignment = align(
        np.array([pose.position for pose in poses]), np.array([pose.position for pose in true])
    )
    assert alignment is not None
    return alignment


def cabinet(say: Say) -> tuple[dict[str, float], list[str]]:
    """tum_fr3_cabinet without poses: free floor, and position and size of the cabinet."""
    path = real_data.folder("tum_fr3_cabinet")
    odometer = Odometer(np.random.default_rng(0))
    say("cabinet: odometry")
    images, true = [], []
    for frame, pose in without_poses(open_recording(path).frames()):
        odometer.track(frame)
        assert frame.depth is not None
        images.append(structured_light.depth(frame.depth))
        true.append(pose)
    poses, _ = odometer.trajectory()
    say("cabinet: surface")
    surface = Tsdf()
    for depth, pose in zip(images, poses, strict=True):
        surface.integrate(depth, pose)
    layers = traversability(surface.mesh())
    alignment = rigid_alignment(poses, true)
    centres = layers.centres.reshape(-1, 2)
    world = alignment.apply(np.column_stack([centres, np.zeros(len(centres))]))[:, :2]
    box = [float(word) for word in (path / "truth_objects.txt").read_text().split()]
    inside = in_rectangle(world, box, 0.0).reshape(layers.height.shape)
    beside = in_rectangle(world, box, CLEAR_M).reshape(layers.height.shape)
    about = in_rectangle(world, box, 0.5).reshape(
        layers.height.shape
    )  # other objects are farther away
    occupied = layers.occupied & about
    iou = float(np.sum(occupied & inside) / np.sum(occupied | inside))
    floor = about & ~beside & layers.known
    free = float(np.mean(layers.probability[floor] > 0.5))
    figures = {"cabinet_footprint_iou": iou, "cabinet_floor_free_share": free}
    return figures, [f"cabinet              footprint IoU {iou:.3f}   floor free {free:.3f}"]


def in_rectangle(
    points: Float[np.ndarray, "n 2"], box: list[float], more_m: float
) -> Bool[np.ndarray, "n"]:
    """Whether points lie in an enlarged rotated rectangle (x y z yaw half-length half-width half-height)."""
    x, y, _, yaw, half_length, half_width, _ = box
    c, s = np.cos(yaw), np.sin(yaw)
    off = points - np.array([x, y])
    along, across = off @ np.array([c, s]), off @ np.array([-s, c])
    return np.asarray(
        (np.abs(along) <= half_length + more_m) & (np.abs(across) <= half_width + more_m)
    )


def run(seeds: int, say: Say, parts: int | None = None) -> Outcome:
    """Cabinet and kitchen once, the office once per seed; `parts`: only the first of them."""
    every = (
        cabinet,
        kitchen,
        partial(office, seeds),
        partial(peers, seeds),
        partial(probabilities, seeds),
    )
    return combined(*(part(say) for part in every[:parts]))


EXPERIMENT = Experiment(
    id="real-mapping",
    title="Surface maps and traversable floor of real places, with true poses and with our own",
    run=run,
    targets={
        "accuracy_true_poses_mm": Target("<=", 3.0),
        "accuracy_mm": Target("<=", 5.0),
        "completeness_5cm": Target(">=", 0.98),
        "completeness_true_poses_5cm": Target(">=", 0.98),
        "cabinet_footprint_iou": Target(">=", 0.85),
        "cabinet_floor_free_share": Target(">=", 0.95),
        "walkable_ratio": Target(">=", 1.0),
        "occupied_share_at_080": Target(">=", 0.7),
        "occupied_share_at_080_min": Target(">=", 0.7),
        "occupied_share_at_080_max": Target("<=", 0.9),
    },
    seeds=1,
)
