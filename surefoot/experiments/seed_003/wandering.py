"""Autonomous exploration: ten minutes in a furnished flat without contact.

Reachable is the true free space for the body; explored is the part of it that the final map knows.

Source: seed 003, sections 2 and 5 (operation planning controller), experiment E6.
"""

from __future__ import annotations

import numpy as np

from planning.planners.mission import MissionConfig

from ...config.presets import on_body
from ...config.schema import Config
from ...evaluation.metrics.maps import UNKNOWN, read_map
from ...results.run_folder import RunFolder
from ...run.simulate import scene_of
from ..support.experiment import Experiment, Outcome, Say, Target
from ..support.walks import total_falls, walk_all

SECONDS = 600.0
BODY_M = 0.20  # planning disc of 0.15 m plus the guard's distance from furniture


def coverage(run: RunFolder, config: Config) -> dict[str, float]:
    """coverage: share of the reachable floor that the final map knows."""
    from sim.free_space import clearance_map

    scene = scene_of(config)
    parts = [part for thing in scene.static_objects for part in thing.parts]
    space = clearance_map(scene.extent, parts)
    assert scene.start is not None
    reachable = space.reachable((scene.start.x, scene.start.y), BODY_M).ravel()
    places = space.centres[reachable]
    grid = read_map(run.path("map.yaml"))
    cells = np.floor((places - grid.origin) / grid.cell_m).astype(int)
    rows, columns = cells[:, 1], cells[:, 0]
    inside = (rows >= 0) & (rows < grid.state.shape[0])
    inside &= (columns >= 0) & (columns < grid.state.shape[1])
    seen = np.zeros(len(places), dtype=bool)
    seen[inside] = grid.state[rows[inside], columns[inside]] != UNKNOWN
    return {"coverage": float(np.mean(seen))}


def run(seeds: int, say: Say, body: str = "kinematic", limit_s: float = SECONDS) -> Outcome:
    """Seeds 0 to n - 1, each walk `limit_s` long."""
    mission = MissionConfig(wander=True, time_limit_s=limit_s)
    configs = [
        on_body(Config(scene="home", seed=seed, mission=mission), body) for seed in range(seeds)
    ]
    found = walk_all(configs, say, coverage)
    share = 100.0 * np.array([metrics["coverage"] for metrics in found])
    contacts = np.array([metrics["contacts"] for metrics in found])
    table = ["seed  contacts  fell  clearance  explored %  path m  rmse cm"]
    for seed, metrics in enumerate(found):
        table.append(
            f"{seed:4d}  {metrics['contacts']:8.0f}  {metrics.get('falls', 0):4.0f}"
            f"  {1e3 * metrics['min_clearance_m']:6.0f} mm"
            f"  {share[seed]:10.1f}   {metrics['path_m']:6.1f}  {100 * metrics['position_rmse_m']:7.2f}"
        )
    return Outcome(
        {
            "collisions": float(contacts.sum()),
            "falls": total_falls(found),
            "coverage_pct": float(share.min()),
            "coverage_pct_mean": float(share.mean()),
            "path_m_mean": float(np.mean([metrics["path_m"] for metrics in found])),
            "min_clearance_mm": 1e3 * min(metrics["min_clearance_m"] for metrics in found),
        },
        table,
    )


EXPERIMENT = Experiment(
    id="003-E6",
    title="Exploring a furnished flat for ten minutes (coverage: the worst seed)",
    run=run,
    body="kinematic",
    targets={"collisions": Target("==", 0.0), "coverage_pct": Target(">=", 80.0)},
)
