"""The whole system in the furnished home, walking on simulated sensors alone and evaluated against the truth.

Every seed has another room, other noise and other moving obstacles. A run is contact-free only if the robot's
body touched nothing in any frame. The errors of moving obstacles are those of every instant at which they have a track, in
view or not. What lasts in a run counts as one draw, so the band of the mean NEES is that of as many samples as runs.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from perception.filtering.consistency import band
from planning.planners.mission import MissionConfig

from ..support.experiment import Experiment, Outcome, Say, Target
from ..support.walks import column, walk_all, walk_figures
from .people_home import config_of


def run(
    seeds: int, say: Say, body: str = "kinematic", limit_s: float = MissionConfig.time_limit_s
) -> Outcome:
    """Seeds 0 to n - 1, each walk at most `limit_s` long."""
    found = walk_all([config_of(seed, body, limit_s) for seed in range(seeds)], say)
    all_of = partial(column, found)
    low, high = band(3, seeds)
    low_movers, high_movers = band(4, seeds)
    movers = float(np.nanmean(all_of("moving_obstacle_anees")))  # NaN: none was tracked
    figures = walk_figures(found)
    figures |= {
        "anees_pose_in_band": float(low <= figures["anees_pose"] <= high),
        "movers_anees": movers,
        "movers_in_band": float(low_movers <= movers <= high_movers),
        "movers_tracked_share": float(np.mean(all_of("moving_obstacle_tracked_share"))),
        "grid_correct_share": float(np.mean(all_of("grid_correct_share"))),
        "grid_correct_share_min": float(np.min(all_of("grid_correct_share"))),
        "floor_deg": float(np.median(all_of("floor_tof_angle_deg_median"))),
        "floor_mm": float(np.median(all_of("floor_tof_height_mm_median"))),
        "path_m_mean": float(np.mean(all_of("path_m"))),
        "poses_in_footprints": float(np.sum(all_of("poses_in_footprints"))),
        "footprints_over_free_share": float(np.max(all_of("footprints_over_free_share"))),
        "footprint_iou_median": float(np.nanmedian(all_of("footprint_iou_median"))),
    }
    table = [
        "seed  contacts  clearance  missed  fell  rmse cm  deg   NEES  grid %  floor deg mm   time s"
        "  movers' NEES  tracked %"
    ]
    for seed, metrics in enumerate(found):
        table.append(
            f"{seed:4d}  {metrics.get('contacts', -1):8.0f}"
            f"  {1e3 * metrics.get('min_clearance_m', np.nan):6.0f} mm"
            f"  {metrics.get('goals_missed', -1):6.0f}  {metrics.get('falls', 0):4.0f}"
            f"  {100 * metrics.get('position_rmse_m', np.nan):7.2f}"
            f"  {metrics.get('heading_rmse_deg', np.nan):4.2f}"
            f"  {metrics.get('pose_anees', np.nan):5.2f}"
            f"  {100 * metrics.get('grid_correct_share', np.nan):6.2f}"
            f"  {metrics.get('floor_tof_angle_deg_median', np.nan):9.2f}"
            f" {metrics.get('floor_tof_height_mm_median', np.nan):4.1f}"
            f"  {metrics.get('duration_s', np.nan):6.1f}"
            f"  {metrics.get('moving_obstacle_anees', np.nan):12.2f}"
            f"  {100 * metrics.get('moving_obstacle_tracked_share', np.nan):9.1f}"
        )
    table.append(
        f"95 % band of the mean NEES over {seeds} runs: {low:.2f} to {high:.2f} of the pose, "
        f"{low_movers:.2f} to {high_movers:.2f} of the movers"
    )
    return Outcome(figures, table)


EXPERIMENT = Experiment(
    id="home",
    title="The whole system in the furnished home, on simulated sensors alone",
    run=run,
    body="kinematic",
    targets={
        "contact_free_share": Target(">=", 1.0),
        "arrived_share": Target(">=", 1.0),
        "position_rmse_m": Target("<=", 0.05),
        "heading_rmse_deg": Target("<=", 2.0),
        "anees_pose_in_band": Target("==", 1.0),
        "movers_in_band": Target("==", 1.0),
        "grid_correct_share": Target(">=", 0.95),
        "floor_deg": Target("<=", 0.5),
        "floor_mm": Target("<=", 5.0),
        "poses_in_footprints": Target("==", 0.0),
        "footprints_over_free_share": Target("==", 0.0),
        "footprint_iou_median": Target(">=", 0.8),
    },
)
