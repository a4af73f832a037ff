"""Whole runs as functions, with arrays in return.

python -m examples.whole_runs
"""

from pathlib import Path

import surefoot as sf

from .my_planner import WalkStraight

WALK = Path(__file__).parents[1] / "data" / "walk"


def main(seconds=20.0):
    run = sf.evaluate(sf.process(WALK))  # any recording; out="runs/mine" keeps the folder
    print(f"{len(run.trajectory)} poses, RMS error {1000 * run.metrics['position_rmse_m']:.0f} mm")
    print(f"{len(run.footprints)} footprints, map of {run.map.probability.shape} cells")

    walk = sf.simulate(
        "boxes", planner=WalkStraight, seed=3, seconds=seconds
    )  # a class, or its name
    print(f"walked to {walk.trajectory.poses[-1, :2]}, reached the goal: {walk.succeeded}")
    return run, walk


if __name__ == "__main__":
    main()
