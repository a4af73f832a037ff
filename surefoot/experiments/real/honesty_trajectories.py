"""Trajectories of real recordings without poses: are their covariances as large as their errors?

The poses of each recording are set aside and serve as truth. The truth has errors too: those of 7-Scenes are
KinectFusion's, good to 1 to 2 cm by the description of the set. The lower figure is used; a pose 1 cm off that looks
at the same surface 3 m away is turned by 0.2 deg. They are modelled as view errors, since KinectFusion places nearly
equal views alike.

The size of the view errors was chosen on tum_fr3_cabinet, their growth with the difference of two views on pairs of
images of tum_fr3_cabinet and 7-Scenes. No image tells that its depth was rendered: where the user does not say it, the
claims allow for a sensor that bends, and are far too careful. Such a run has a line and no target.

Source: ours.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from perception.odometry.view_errors import view_error_covariances

from ...evaluation.evaluate import aligned_errors
from ...evaluation.metrics.gauge_alignment import aligned_consistency
from ...results.run_folder import RunFolder
from ..support.experiment import Part

TRUTH_SIGMA = {
    "sevenscenes_sweep": (0.010, np.radians(0.2)),
    "sevenscenes_pan": (0.010, np.radians(0.2)),
}
"""Standard deviations of a true pose, m and rad; exact or by motion capture if not listed."""


def variance_ratio(folder: Path, truth_sigma: tuple[float, float]) -> float:
    """Mean NEES per degree of freedom of a run after rigid alignment: 1 if consistent.

    Args:
        folder: Run folder with trajectory.txt, space_covariance.csv and truth/trajectory.txt.
        truth_sigma: Standard deviation of the truth, m and rad.
    """
    run = RunFolder(folder)
    estimate = run.read_trajectory("trajectory.txt")
    true = run.read_trajectory("truth/trajectory.txt")
    found = None if estimate is None or true is None else aligned_errors(run, estimate, true)
    if found is None or estimate is None:
        return float("nan")
    stamps, errors, covariances = found
    at = np.searchsorted(estimate.stamps, stamps)
    own = np.diag(np.square([truth_sigma[0]] * 3 + [truth_sigma[1]] * 3))
    rotations = Rotation.from_quat(estimate.quats_xyzw[at]).as_matrix()
    of_truth = view_error_covariances(estimate.positions[at], rotations, own).aligned
    return float(aligned_consistency(errors, covariances + of_truth)["pose_variance_ratio"])


def part(runs: Mapping[tuple[str, str], Path], unsaid: Mapping[str, Path] | None = None) -> Part:
    """Figures and table lines.

    Args:
        runs: Folder of each run without poses, by verb and recording.
        unsaid: Runs of rendered recordings whose user did not say so: claimed as of a sensor that bends.
    """
    ratios = {
        (verb, name): variance_ratio(folder, TRUTH_SIGMA.get(name, (0.0, 0.0)))
        for (verb, name), folder in runs.items()
    }
    figures = {f"trajectory_ratio_{verb}_{name}": one for (verb, name), one in ratios.items()}
    figures["trajectory_ratio_max"] = max(ratios.values())
    figures["trajectory_ratio_min"] = min(ratios.values())
    rows = [
        f"{name:<20} {verb:<8} variance of the trajectory's errors / claimed {one:6.2f}"
        for (verb, name), one in ratios.items()
    ]
    for name, folder in (unsaid or {}).items():
        one = variance_ratio(folder, TRUTH_SIGMA.get(name, (0.0, 0.0)))
        figures[f"trajectory_ratio_unsaid_{name}"] = one
        rows.append(f"{name:<20} process  the same, not said to be rendered            {one:6.2f}")
    return figures, rows
