"""What is claimed on real recordings, against their truth: floors, static obstacles, footprints, trajectories.

Tracks, footprints and trajectories are taken from the files that a user gets from `process` and `map`; the names of
runs whose poses were set aside end in _blind. Each part names the recordings that chose its parameters.

Source: ours.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from ...config.schema import Config
from ...offline.job import Job
from ...offline.map import map_recording
from ...run.process import process
from ..support import real_data
from ..support.experiment import Experiment, Outcome, Say, Target, combined
from . import honesty_floors, honesty_footprints, honesty_tracks, honesty_trajectories

STATIC = {
    "tum_fr3_cabinet": "tum_fr3_cabinet",
    "sevenscenes_sweep": "sevenscenes_redkitchen/sweep",
    "sevenscenes_pan": "sevenscenes_redkitchen/pan",
    "redwood_livingroom": "redwood_livingroom",
    "replica_office0": "replica_office0",
    "realsense_low_boxes": "realsense_low_boxes",
}
"""Recordings in which nothing moves, and their folders."""

WITH_TRUTH = ("tum_fr3_cabinet", "sevenscenes_sweep", "sevenscenes_pan", "redwood_livingroom")
"""Recordings with poses of three frames at least."""

RENDERED = ("redwood_livingroom",)
"""Recordings whose description says that their depth is rendered, which their files do not: the user must say it."""


def run(seeds: int, say: Say, floors_alone: bool = False) -> Outcome:
    """All recordings once; independent of the seeds.

    Args:
        seeds: Without effect.
        say: Takes lines of progress.
        floors_alone: Without processing and mapping whole recordings, which takes most of the time.
    """
    if floors_alone:
        return combined(honesty_floors.part(say))
    with tempfile.TemporaryDirectory() as place:
        root = Path(place)
        runs = {name: _processed(name, root / name, Config(), say) for name in STATIC}
        blind = Config(ignore_poses=True)
        without: dict[tuple[str, str], Path] = {}
        for name in WITH_TRUTH:
            runs[f"{name}_blind"] = _processed(name, root / f"{name}-blind", blind, say)
            without["process", name] = runs[f"{name}_blind"]
            without["map", name] = _mapped(name, root / f"{name}-map", blind, say)
        unsaid = {
            name: _processed(name, root / f"{name}-unsaid", blind, say, rendered=False)
            for name in RENDERED
        }
        return combined(
            honesty_floors.part(say),
            honesty_tracks.part(runs, say),
            honesty_footprints.part(runs, say),
            honesty_trajectories.part(without, unsaid),
        )


def _processed(name: str, out: Path, config: Config, say: Say, rendered: bool = True) -> Path:
    description = _description(name, out) if rendered else None
    folder = real_data.folder(STATIC[name])
    process(folder, description, config, out, lambda text: say(f"{name}: {text}"))
    return out


def _description(name: str, out: Path) -> Path | None:
    """What the user of a recording writes beside it; None where nothing need be said."""
    if name not in RENDERED:
        return None
    path = out.parent / f"{name}.toml"
    path.write_text("calibrated = true\n", encoding="utf-8")
    return path


def _mapped(name: str, out: Path, config: Config, say: Say) -> Path:
    job = Job.open("map", real_data.folder(STATIC[name]), _description(name, out), config, out)
    map_recording(job, lambda text: say(f"{name}: map, {text}"))
    return out


EXPERIMENT = Experiment(
    id="real-honesty",
    title="Claims on real recordings: floors, static obstacles, footprints and trajectories",
    run=run,
    targets={
        "floor_anees_max": Target("<=", 2.0),
        "trajectory_ratio_max": Target("<=", 2.5),
        "trajectory_ratio_min": Target(">=", 0.4),
        "static_movers": Target("==", 0.0),
        "footprints_over_free_share": Target("==", 0.0),
    },
    seeds=1,
)
