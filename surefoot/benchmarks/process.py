"""A recording of depth and colour at 640x480: odometry and surface map against Open3D, and the complete chain.

The images are five of Redwood's living room if available, else a synthetic room: two walls and a floor, seen by a
moving camera. The time of ours includes the image pyramid; the images of Open3D are converted beforehand.

The hardest peers: the fastest odometry of Open3D, small_gicp, and Open3D's voxel grid with the better of two block
sizes. The complete chain is timed twice: its processor time with images in memory, and its wall time from PNG files.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from itertools import cycle
from typing import Any

import numpy as np

from mapping.surface.tsdf import Tsdf
from mapping.surface.tsdf_config import TsdfConfig
from mapping.surface.tsdf_open3d import Open3dMap
from perception.depth import structured_light
from perception.odometry.baselines import small_gicp_motion
from perception.odometry.odometry import Odometry
from perception.odometry.pyramid import build
from perception.primitives.camera import Camera
from perception.primitives.errors import InputError
from perception.primitives.frame import DepthView
from perception.primitives.pose import Pose3

from ..experiments.support import real_data
from ..recordings.open import open_recording
from .benchmark import Benchmark, Comparison, race
from .chain import Image, from_files, in_memory, swing

Motion = Callable[[int, int], np.ndarray]
"""T_target_source of the images of two numbers, (4, 4)."""
PEERS = {
    "ratio_odometry_open3d": "Open3D odometry, hybrid",
    "ratio_odometry_open3d_plane": "Open3D odometry, point to plane",
    "ratio_odometry_small_gicp": "small_gicp",
    "ratio_tsdf_open3d": "Open3D VoxelBlockGrid",
    "ratio_tsdf_open3d_blocks_of_8": "Open3D VoxelBlockGrid, smaller blocks",
}


def images() -> list[Image]:
    """Depth, colour and true pose."""
    try:
        recording = open_recording(real_data.folder("redwood_livingroom"))
    except InputError:
        return synthetic()
    found = []
    for frame in recording.frames():
        assert frame.depth is not None
        assert frame.colour is not None
        assert frame.T_world_camera is not None
        depth = structured_light.depth(frame.depth)
        found.append((depth, frame.colour.rgb, frame.T_world_camera))
    return found


def synthetic() -> list[Image]:
    """Five views of a corner with a floor, from exact planes with noise."""
    camera = Camera(640, 480, 525.0, 525.0, 319.5, 239.5)
    rng = np.random.default_rng(0)
    planes = np.array([[0.0, 0.0, 1.0, 3.0], [1.0, 0.0, 0.2, 1.6], [0.0, 1.0, 0.1, 0.9]])
    found = []
    for number in range(5):
        pose = Pose3((0.02 * number, 0.0, 0.01 * number), (0.0, 0.0, 0.0, 1.0))
        approach = camera.rays @ planes[:, :3].T
        distance = planes[:, 3] - planes[:, :3] @ pose.position
        with np.errstate(divide="ignore"):
            z = np.where(approach > 1e-6, distance / approach, np.inf).min(axis=-1)
        points_world = pose.apply(camera.rays * z[..., None])
        light = 128 + 60 * np.sin(7 * points_world[..., 0]) * np.sin(
            9 * points_world[..., 1] + 5 * points_world[..., 2]
        )
        rgb = np.repeat(light[..., None], 3, axis=2).astype(np.uint8)
        noisy = (z + rng.normal(0.0, 0.002, z.shape) * z**2).astype(np.float32)
        found.append((structured_light.depth(DepthView(noisy, camera)), rgb, pose))
    return found


def run() -> Comparison:
    """Odometry, surface map, and the complete chain."""
    given = images()
    odometry, drift = _race_odometry(given)
    surface = _race_tsdf(given)
    chain, wall = in_memory(given), from_files(given)
    times = {**odometry, **surface, "chain_ms": 1e3 / chain, "wall_ms": 1e3 / wall}
    ratios = {"frames_per_second": chain, "wall_frames_per_second": wall}
    for measured in (odometry, surface):
        ours = next(name for name in measured if "_ours" in name)
        for name in measured.keys() - {ours}:
            ratios[f"ratio_{name.removesuffix('_ms')}"] = measured[name] / measured[ours]
    fair = {said: ratios[name] for name, said in PEERS.items() if name in ratios}
    missing = [] if "ratio_odometry_small_gicp" in ratios else ["small_gicp"]
    return Comparison(times, dict(sorted(ratios.items())), drift, fair, missing)


def _race_odometry(given: list[Image]) -> tuple[dict[str, float], dict[str, float]]:
    """Times of ours and its peers, and the mean error of the motion between two images, m."""
    odometry, turn = Odometry(), cycle(swing(len(given)))

    def track() -> None:
        number = next(turn)
        odometry.track(build(given[number][0], given[number][1]))

    candidates: dict[str, Callable[[], None]] = {"odometry_ours_ms": track}
    errors: dict[str, list[float]] = {"odometry_ours_m": _errors(given)}
    for name, motion in _motions(given).items():
        errors[f"{name}_m"] = []
        candidates[f"{name}_ms"] = _follower(given, motion, errors[f"{name}_m"])
    taken = race(candidates, 24)
    means = {name: float(np.mean(values)) for name, values in errors.items()}
    means["odometry_error_share"] = means["odometry_ours_m"] / means["odometry_open3d_m"]
    return taken, means


def _follower(given: list[Image], motion: Motion, errors: list[float]) -> Callable[[], None]:
    """Align the next image with the one before, and note the error."""
    turn = cycle(swing(len(given)))
    last = [next(turn)]

    def step() -> None:
        number = next(turn)
        moved = motion(last[0], number)[:3, 3]
        true = given[last[0]][2].inverse() @ given[number][2]
        errors.append(float(np.linalg.norm(moved - true.position)))
        last[0] = number

    return step


def _errors(given: list[Image]) -> list[float]:
    """Errors of our motions between the images, m."""
    fresh, before, errors = Odometry(), Pose3(), []
    for number, (depth, rgb, pose) in enumerate(given):
        here = fresh.track(build(depth, rgb)).T_start_camera
        if number:
            true = given[number - 1][2].inverse() @ pose
            moved = (before.inverse() @ here).position
            errors.append(float(np.linalg.norm(moved - true.position)))
        before = here
    return errors


def _motions(given: list[Image]) -> dict[str, Motion]:
    """T_target_source of the images of two numbers, by each installed peer; its input is prepared beforehand."""
    import open3d

    core: Any = open3d.core
    engine: Any = open3d.t.pipelines.odometry
    geometry: Any = open3d.t.geometry
    pairs = [
        geometry.RGBDImage(
            geometry.Image(np.ascontiguousarray(rgb.astype(np.float32) / 255.0)),
            geometry.Image(np.ascontiguousarray(np.nan_to_num(depth.z)[..., None])),
        )
        for depth, rgb, _ in given
    ]
    K, start = core.Tensor(given[0][0].camera.matrix), core.Tensor(np.eye(4))
    steps = [engine.OdometryConvergenceCriteria(n) for n in (10, 5, 3)]

    def by_open3d(method: Any, target: int, source: int) -> np.ndarray:
        found = engine.rgbd_odometry_multi_scale(
            pairs[source],
            pairs[target],
            K,
            start,
            1.0,
            6.0,
            steps,
            method,
            engine.OdometryLossParams(),
        )
        return np.asarray(found.transformation.numpy())

    motions: dict[str, Motion] = {
        "odometry_open3d": partial(by_open3d, engine.Method.Hybrid),
        "odometry_open3d_plane": partial(by_open3d, engine.Method.PointToPlane),
    }
    with suppress(ImportError):
        importlib.import_module("small_gicp")
        levels = [build(depth, rgb).levels[0] for depth, rgb, _ in given]

        def by_small_gicp(target: int, source: int) -> np.ndarray:
            found = small_gicp_motion(levels[target], levels[source], Pose3())
            assert found is not None, "the images have depth"
            return found[0]

        motions["odometry_small_gicp"] = by_small_gicp
    return motions


def _race_tsdf(given: list[Image]) -> dict[str, float]:
    config = TsdfConfig(voxel_m=0.02)
    maps: dict[str, Tsdf | Open3dMap] = {
        "tsdf_ours_ms": Tsdf(config),
        "tsdf_open3d_ms": Open3dMap(config, 16),
        "tsdf_open3d_blocks_of_8_ms": Open3dMap(config, 8),
    }
    candidates = {}
    for name, surface in maps.items():
        turn = cycle(given)

        def fuse(surface: Tsdf | Open3dMap, turn: Any) -> None:
            depth, rgb, pose = next(turn)
            surface.integrate(depth, pose, rgb)

        candidates[name] = partial(fuse, surface, turn)
    return race(candidates, 20)


BENCHMARK = Benchmark(
    "process",
    "A depth recording at 640x480: odometry, surface map, complete chain",
    run,
    {
        "frames_per_second": 30.0,
        "wall_frames_per_second": 40.0,
        "ratio_odometry_open3d": 3.0,
        "ratio_tsdf_open3d": 2.0,
    },
    {"odometry_error_share": 1.0},
)
