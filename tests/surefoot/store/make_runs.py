"""Small run folders with known numbers."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from perception.primitives.gaussian import Gaussian
from surefoot.results.run_folder import COVARIANCE_HEADER, MARK, RunFolder, estimate_row
from surefoot.run.run_recorder import COMMAND_HEADER, FLOOR_HEADER

COVARIANCE = np.diag([4e-4, 1e-4, 9e-4])
TILT_SIGMA_DEG = 0.5


def make_run(
    place: Path, *, seed: int = 0, ate_m: float = 0.02, frames: int = 4, recording: str = ""
) -> RunFolder:
    """A finished walk of `frames` frames, one a second and 0.1 m apart, off by 1 cm to the left."""
    place.mkdir(parents=True)
    (place / MARK).write_text("1\n")
    run = RunFolder(place)
    run.write_text("config.toml", f'scene = "home"\nseed = {seed}\n[mission]\nplanner = "search"\n')
    poses = [
        estimate_row(float(k), Gaussian(np.array([0.1 * k, 0.01, 0.0]), COVARIANCE))
        for k in range(frames)
    ]
    run.write_csv("trajectory_covariance.csv", COVARIANCE_HEADER, poses)
    run.write_planar_trajectory()
    run.write_trajectory(
        "truth/trajectory.txt", [(float(k), 0.1 * k, 0.0, 0.0, 0.0) for k in range(frames)]
    )
    run.write_csv(
        "timing.csv", ("stamp_s", "depth", "floor"), [(float(k), 2.0, 3.0) for k in range(frames)]
    )
    large, small = math.radians(TILT_SIGMA_DEG) ** 2, 1e-8
    turned = (large + small) / 2, (large - small) / 2  # the two axes, turned by 45 deg
    plane = (turned[0], turned[1], 0.0, turned[0], 0.0, 1e-6)
    run.write_csv(
        "floor.csv",
        FLOOR_HEADER,
        [
            (float(k), "depth", 0.0, -1.0, 0.0, 0.5, *plane, 0.4, "expected" if k == 0 else "seen")
            for k in range(frames)
        ],
    )
    run.write_csv(
        "commands.csv", COMMAND_HEADER, [(1.0, 0.1, 0.0, 0.2, 0.0, 0.3, "straight on", None)]
    )
    run.write_json("obstacles.json", {"tracks": [track(1, 0.9), track(1, 0.8, 1.0), track(2, 0.2)]})
    run.write_json("metrics.json", {"ate_m": ate_m, "pose_anees": 6.0, "pose_consistent": True})
    run.write_json(
        "summary.json",
        {
            "kind": "mcap" if recording else "simulation", "name": place.name, "command": "surefoot", "version": "0.1.0", "commit": "abc",
            "frames": frames, "skipped": {"blurred": 2, "dark": 1}, "seconds": frames - 1.0, "notes": ["one", "two"],
            "trajectory": "body", "recording_identity": recording,
        },
    )  # fmt: skip
    return run


def track(number: int, moving: float, stamp_s: float = 0.0) -> dict[str, object]:
    """An entry of obstacles.json."""
    covariance = (np.arange(16.0).reshape(4, 4) + np.arange(16.0).reshape(4, 4).T).tolist()
    modes = {"still": 1.0 - moving, "straight": moving}
    return {
        "stamp": stamp_s, "track": number, "mean": [1.0, 2.0, 3.0, 4.0], "covariance": covariance, "radius_m": 0.2,
        "height_m": None, "moving": moving, "modes": modes, "seen": stamp_s,
    }  # fmt: skip
