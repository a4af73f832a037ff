"""Strangers: every law meets every scene on both bodies, and what a run folder says of its movers."""

import numpy as np
import pytest

from sim.scenes import catalogue
from surefoot.experiments.joint.prediction import DEVELOPMENT
from surefoot.experiments.joint.strangers import LAWS, config_of, walked
from surefoot.results.run_folder import RunFolder


@pytest.mark.parametrize("law", LAWS)
def test_six_seeds_bring_a_law_into_every_scene_on_both_bodies(law):
    met = {(c.scene, c.robot.body) for c in (config_of(law, seed) for seed in range(6))}
    assert len(met) == 6
    assert law not in DEVELOPMENT


def test_a_mover_in_sight_counts_as_followed_only_while_it_has_a_track(tmp_path):
    """One mover 1 m ahead of the robot, tracked half of the time 2 cm beside its place; the others are far away."""
    config = config_of("stream", 2)
    scene = catalogue.load(config.scene, config.seed, config.difficulty, config.movers)
    assert config.scene == "hall"
    count, stamps = len(scene.moving_objects), np.arange(0.0, 10.0, 0.5)
    x, y = scene.start.x, scene.start.y
    folder = RunFolder.create(tmp_path / "run")
    rows = [
        (t, k + 1, x + (1.0 if k == 0 else 6.0), y + 0.3 * k, 0.1, 0.0, 0.1, 1.6, f"person {k + 1}")
        for t in stamps
        for k in range(count)
    ]
    names = [
        "stamp_s",
        "identity",
        "x_m",
        "y_m",
        "vx_mps",
        "vy_mps",
        "radius_m",
        "height_m",
        "name",
    ]
    folder.write_csv("truth/obstacles.csv", names, rows)
    folder.write_csv(
        "truth/clearance.csv",
        ("stamp_s", "clearance_m", "object"),
        [(t, -0.01 if t == 5.0 else 0.3, "pillar 1") for t in stamps],
    )
    folder.write_trajectory("truth/trajectory.txt", [(t, x, y, 0.0, 0.0) for t in stamps])
    tracks = [
        {
            "stamp": t,
            "track": 1,
            "mean": [x + 1.02, y, 0.1, 0.0],
            "covariance": (1e-4 * np.eye(4)).tolist(),
            "seen": t,
        }
        for t in stamps[:10].tolist()
    ]
    folder.write_json("obstacles.json", {"tracks": tracks})
    found = walked(folder, config)
    assert (found["near"], found["followed"]) == (20.0, 10.0)
    assert found["nees_count"] == 10.0
    assert found["nees_sum"] == pytest.approx(10 * 4.0)  # 2 cm by a sigma of 1 cm
    assert (found["contacts_avoidable"], found["contacts_unseen"]) == (1.0, 0.0)
