"""The whole stack in the furnished home with people moving, on the body that really walks.

As the experiment `home`, but servos, soles and gravity make the steps, odometry comes from foot to foot,
and the cameras sway with the head. Every contact counts; its class tells whose fault it was.
"""

from __future__ import annotations

import numpy as np

from ...config.presets import on_body
from ...config.schema import Config
from ...evaluation.metrics.contact_classes import CLASSES, class_counts, contact_classes
from ...results.run_folder import RunFolder
from ..support.experiment import Experiment, Outcome, Say, Target
from ..support.walks import walk_all


def config_of(seed: int, body: str = "dynamic") -> Config:
    """The home of a seed, walked with this body."""
    return on_body(Config(scene="home", seed=seed), body)


def falls_and_contacts(folder: RunFolder, config: Config) -> dict[str, float]:
    """falls (0 or 1), and contacts by class, of a run."""
    summary = folder.read_json("summary.json") or {}
    figures = {"falls": float(summary.get("fell_at_s") is not None)}
    clearance = folder.read_csv("truth/clearance.csv")
    obstacles = folder.read_csv("truth/obstacles.csv")
    walked = folder.read_trajectory("truth/trajectory.txt")
    tracks = (folder.read_json("obstacles.json") or {}).get("tracks", [])
    if clearance is not None and obstacles is not None and walked is not None:
        poses = np.column_stack([walked.stamps, walked.positions[:, :2], walked.yaws])
        figures |= class_counts(contact_classes(clearance, poses, obstacles, tracks))
    return figures


def run(seeds: int, say: Say, body: str = "dynamic") -> Outcome:
    """Seeds 0 to n - 1."""
    found = walk_all([config_of(seed, body) for seed in range(seeds)], say, falls_and_contacts)

    def all_of(name: str) -> np.ndarray:
        return np.array([metrics.get(name, np.nan) for metrics in found], dtype=float)

    figures = {
        "contact_free_share": float(np.mean(all_of("contacts") == 0)),
        "contacts": float(np.sum(all_of("contacts"))),
        "avoidable_contacts": float(np.sum(all_of("contacts_avoidable"))),
        "arrived_share": float(np.mean(all_of("goals_missed") == 0)),
        "falls": float(np.sum(all_of("falls"))),
        "position_rmse_m": float(np.sqrt(np.mean(all_of("position_rmse_m") ** 2))),
        "heading_rmse_deg": float(np.sqrt(np.mean(all_of("heading_rmse_deg") ** 2))),
        "anees_pose": float(np.mean(all_of("pose_anees"))),
        "min_clearance_mm": 1e3 * float(np.min(all_of("min_clearance_m"))),
        "time_s_mean": float(np.mean(all_of("duration_s"))),
    }
    figures |= {f"contacts_{kind}": float(np.sum(all_of(f"contacts_{kind}"))) for kind in CLASSES}
    table = ["seed  contacts  clearance  missed  fell  rmse cm   deg   NEES  time s"]
    for seed, metrics in enumerate(found):
        table.append(
            f"{seed:4d}  {metrics.get('contacts', -1):8.0f}"
            f"  {1e3 * metrics.get('min_clearance_m', np.nan):6.0f} mm"
            f"  {metrics.get('goals_missed', -1):6.0f}  {metrics.get('falls', -1):4.0f}"
            f"  {100 * metrics.get('position_rmse_m', np.nan):7.2f}"
            f"  {metrics.get('heading_rmse_deg', np.nan):4.2f}"
            f"  {metrics.get('pose_anees', np.nan):5.2f}  {metrics.get('duration_s', np.nan):6.1f}"
        )
    return Outcome(figures, table)


EXPERIMENT = Experiment(
    id="INT-1",
    title="The whole stack at home among moving people, on the dynamic body",
    run=run,
    body="dynamic",
    targets={
        "contact_free_share": Target(">=", 0.95),
        "avoidable_contacts": Target("==", 0.0),
        "arrived_share": Target(">=", 0.95),
        "falls": Target("==", 0.0),
    },
    seeds=20,
)
