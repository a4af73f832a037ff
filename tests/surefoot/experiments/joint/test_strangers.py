"""Strangers: every law meets every scene on both bodies, and what a run folder says of its movers."""

import numpy as np
import pytest

from sim.scenes import catalogue
from surefoot.experiments.joint import strangers
from surefoot.experiments.joint.prediction import DEVELOPMENT
from surefoot.experiments.joint.strangers import EXPERIMENT, LAWS, config_of, walked
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
    folder.write_csv("commands.csv", ("stamp_s", "risk"), [(t, 0.03) for t in stamps])
    found = walked(folder, config)
    assert (found["near"], found["followed"]) == (20.0, 10.0)
    assert found["nees_count"] == 10.0
    assert found["nees_sum"] == pytest.approx(10 * 4.0)  # 2 cm by a sigma of 1 cm
    assert (found["contacts_avoidable"], found["contacts_unseen"]) == (1.0, 0.0)
    sums = [found[f"risk_{name}_1"] for name in ("decisions", "claimed", "happened")]
    assert sums == pytest.approx([20.0, 0.6, 0.0])  # the pillar that was touched does not move


def test_all_targets_are_measured_and_risks_of_all_walks_add_up(monkeypatch):
    """Two walks: 1000 decisions that claim 10 %, of which 0 in one and 200 in the other were followed by a contact."""
    walks = [
        {
            "contacts": contacts, "goals_missed": 0.0, "duration_s": 60.0, "min_clearance_m": 0.1,
            "position_rmse_m": 0.01, "heading_rmse_deg": 0.2, "pose_anees": 3.0,
            "nees_sum": 400.0, "nees_count": 100.0, "near": 100.0, "followed": 95.0,
            "risk_decisions_2": 1000.0, "risk_horizons_2": 500.0, "risk_claimed_2": 100.0,
            "risk_happened_2": happened,
        }
        for contacts, happened in ((0.0, 0.0), (2.0, 200.0))
    ]  # fmt: skip
    monkeypatch.setattr(strangers, "walk_all", lambda *_: walks)
    figures = strangers.run(1, lambda _: None, laws=2).figures
    assert set(EXPERIMENT.targets) <= set(figures)
    assert (figures["risk_claimed_mean"], figures["risk_happened_share"]) == (0.1, 0.1)
    assert figures["risk_in_band"] == 1.0
    walks[0]["risk_happened_2"] = 200.0
    assert strangers.run(1, lambda _: None, laws=2).figures["risk_in_band"] == 0.0
