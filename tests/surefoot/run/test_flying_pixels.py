"""Flying pixels of a time-of-flight camera make no obstacles in the map of a run, nor surface of `surefoot map`."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mapping.surface.traversability import load_layers
from perception.depth import structured_light
from perception.primitives.camera import Camera
from perception.primitives.frame import DepthView, Frame
from perception.primitives.gaussian import Gaussian
from perception.primitives.plane import Plane
from perception.primitives.pose import Pose3
from surefoot.config.schema import Config
from surefoot.offline.fusion import Fusion
from surefoot.offline.placed_images import PlacedImage
from surefoot.recordings.recording import RecordingInfo
from surefoot.results.run_folder import RunFolder
from surefoot.run.pipeline import Pipeline

CAMERA = Camera(320, 240, 262.0, 262.0, 159.5, 119.5)
EYE_M = 0.9
AHEAD_M, HALF_M, TOP_M, WALL_M = 1.2, 0.2, 0.5, 2.4
"""Front of a box before the camera, half its width, its height, and a wall."""
PITCH_RAD = np.radians(25.0)
AXES = np.array(
    [
        [0.0, -np.sin(PITCH_RAD), np.cos(PITCH_RAD)],
        [-1.0, 0.0, 0.0],
        [0.0, -np.cos(PITCH_RAD), -np.sin(PITCH_RAD)],
    ]
)
"""Camera (x right, y down, z ahead) in the world (x ahead, z up)."""


def view(rng: np.random.Generator, mixed: bool, left_m: float = 0.0) -> np.ndarray:
    """Depth of the box on a floor before a wall; every second pixel beside an edge lies between.

    The camera is `left_m` left of the box's middle.
    """
    rays = CAMERA.rays.reshape(-1, 3) @ AXES.T
    with np.errstate(divide="ignore", invalid="ignore"):
        floor = np.where(rays[:, 2] < 0.0, -EYE_M / rays[:, 2], np.inf)
        front = AHEAD_M / rays[:, 0]
        top = (TOP_M - EYE_M) / rays[:, 2]
    across, up = left_m + front * rays[:, 1], EYE_M + front * rays[:, 2]
    z = np.minimum(floor, WALL_M / rays[:, 0])
    z = np.where((np.abs(across) < HALF_M) & (up > 0.0) & (up < TOP_M), np.minimum(z, front), z)
    on_top = (
        (np.abs(left_m + top * rays[:, 1]) < HALF_M)
        & (top > 0.0)
        & (np.abs(top * rays[:, 0] - AHEAD_M - HALF_M) < HALF_M)
    )
    z = np.where(on_top, np.minimum(z, top), z).reshape(CAMERA.height, CAMERA.width)
    if mixed:
        near, far = np.minimum(z[:, :-2], z[:, 2:]), np.maximum(z[:, :-2], z[:, 2:])
        between = near + (far - near) * rng.uniform(size=near.shape)
        edge = (far - near > 0.2) & (rng.uniform(size=near.shape) < 0.5)
        z[:, 1:-1] = np.where(edge, between, z[:, 1:-1])
    return (z + 0.003 * rng.standard_normal(z.shape)).astype(np.float32)


def stray_cells(mixed: bool) -> int:
    """Occupied cells away from the box and the wall."""
    rng = np.random.default_rng(0)
    info = RecordingInfo("room", "plain", poses_given=True, gravity_up_world=(0.0, 0.0, 1.0))
    pipeline = Pipeline(Config(), info)
    pose = Pose3.from_rotation(AXES, np.array([0.0, 0.0, EYE_M]))
    for k in range(8):
        seen = DepthView(view(rng, mixed), CAMERA)
        pipeline.cycle(Frame(stamp_s=0.2 * k, depth=seen, T_world_camera=pose))
    world = pipeline.maps.world
    assert world is not None
    return away(world.probability > 0.5, world.origin, world.cell_m)


def away(occupied: np.ndarray, origin: np.ndarray, cell_m: float) -> int:
    """Number of occupied cells away from the box and the wall; there are others."""
    rows, columns = np.nonzero(occupied)
    x, y = (origin + cell_m * (np.column_stack([columns, rows]) + 0.5)).T
    assert len(x) > 50
    box = np.hypot(
        np.maximum(np.abs(x - AHEAD_M - HALF_M) - HALF_M, 0.0), np.maximum(np.abs(y) - HALF_M, 0.0)
    )
    return int(np.count_nonzero((box > 0.06) & (np.abs(x - WALL_M) > 0.06)))


def test_mixed_pixels_at_the_edges_of_a_box_do_not_occupy_the_space_behind_it():
    assert stray_cells(mixed=False) == 0
    assert stray_cells(mixed=True) == 0


def stray_surface(folder: Path, mixed: bool) -> int:
    """Cells of `layers.npz` with surface above the reach of a step, away from the box and the wall."""
    rng = np.random.default_rng(0)
    fusion = Fusion(RunFolder.create(folder), Config())
    place = Gaussian(np.zeros(3), 1e-6 * np.eye(3))
    floor = Plane(np.array([0.0, 0.0, 1.0]), 0.0)
    for k in range(16):
        left_m = 0.02 * k - 0.15
        depth = structured_light.depth(DepthView(view(rng, mixed, left_m), CAMERA))
        pose = Pose3.from_rotation(AXES, np.array([0.0, left_m, EYE_M]))
        fusion.add(PlacedImage("depth", depth, None, pose, place, floor, 0.2 * k), float(k))
    fusion.close()
    fusion.write(lambda text: None)
    layers = load_layers(folder / "layers.npz")
    return away(layers["elevation"] > 0.03, layers["origin"], float(layers["resolution"]))


def test_mixed_pixels_make_no_surface_behind_the_edges_of_a_box(tmp_path):
    assert stray_surface(tmp_path / "clean", mixed=False) == 0
    assert stray_surface(tmp_path / "mixed", mixed=True) == 0
