"""Verbs as functions: runs with arrays."""

from __future__ import annotations

import gc
from pathlib import Path

import numpy as np
import pytest

import surefoot
from planning.gaze.policy import POLICIES
from planning.planners.mission import PLANNERS
from surefoot.library.verbs import configuration
from surefoot.results.run_folder import RunFolder

ONE_CAMERA = {"robot.stereo": False, "robot.colour": False}
WALK = Path(__file__).resolve().parents[3] / "data" / "walk"


@pytest.fixture(scope="module")
def processed(pages) -> surefoot.Run:
    run = surefoot.process(WALK)
    with pages():
        return surefoot.evaluate(run)


def test_a_processed_recording_is_there_as_arrays(processed):
    frames = processed.summary["frames"]
    trajectory = processed.trajectory
    assert trajectory is not None
    assert trajectory.poses.shape == (frames, 3)
    assert trajectory.covariances.shape == (frames, 3, 3)
    assert (np.linalg.eigvalsh(trajectory.covariances) > 0.0).all()
    assert processed.floor is not None
    assert processed.floor.normals.shape == (len(processed.floor), 3)
    np.testing.assert_allclose(np.linalg.norm(processed.floor.normals, axis=1), 1.0)
    tracks = processed.tracks
    assert tracks.states.shape == (len(tracks), 4)
    assert tracks.covariances.shape == (len(tracks), 4, 4)
    assert processed.map is not None
    assert processed.map.probability.shape == processed.map.known.shape
    assert processed.grid is not None
    assert processed.footprints
    assert processed.report.is_file()
    assert processed.succeeded


def test_the_figures_against_the_truth_come_with_the_run(processed):
    assert processed.metrics["position_rmse_m"] < 0.05
    truth = RunFolder(processed.folder).read_trajectory("truth/trajectory.txt")
    assert truth is not None
    at = np.searchsorted(truth.stamps, processed.trajectory.stamps_s)
    at = np.minimum(at, len(truth) - 1)
    errors = np.linalg.norm(processed.trajectory.poses[:, :2] - truth.positions[at, :2], axis=1)
    assert np.median(errors) < 0.05


def test_the_words_for_planners_and_gaze_policies_are_all_of_them():
    for name in (*PLANNERS, *POLICIES):
        assert f'"{name}"' in surefoot.simulate.__doc__


def test_settings_may_be_numbers_of_numpy():
    given = {"reach.tof.farthest_m": np.float32(2.0), "mission.goals": np.int64(1)}
    config = configuration(None, {**given, "mission.headings_deg": np.array([90.0])})
    assert config.reach.tof.farthest_m == 2.0
    assert config.mission.headings_deg == (90.0,)


def test_a_temporary_folder_goes_with_its_run():
    run = surefoot.simulate("empty_room", seconds=1.5, settings=ONE_CAMERA)
    folder = run.folder
    assert folder.is_dir()
    del run
    gc.collect()
    assert not folder.exists()


def test_a_named_folder_stays_and_opens_again(tmp_path):
    run = surefoot.simulate(
        "empty_room",
        seconds=1.5,
        out=tmp_path / "walk",
        settings={**ONE_CAMERA, "reach.tof.farthest_m": 2.5},
    )
    assert "farthest_m = 2.5" in run.path("config.toml").read_text()
    again = surefoot.Run(tmp_path / "walk")
    assert run.trajectory is not None
    assert again.trajectory is not None
    np.testing.assert_array_equal(again.trajectory.poses, run.trajectory.poses)


class Still:
    """A planner that stands."""

    reached = 0

    def __init__(self, config, goals):
        self.seconds = config.mission.time_limit_s

    def observe(self, world):
        """Nothing to keep."""

    def decide(self, world):
        """Stay."""
        return surefoot.Decision(surefoot.WalkCommand(), surefoot.GazeCommand(), "still")

    def distance_to_goal(self, world):
        """Unknown."""
        return 0.0

    def finished(self, world):
        """When the time is up."""
        return world.stamp_s >= self.seconds


def test_a_class_of_ones_own_walks_and_is_named_in_the_config():
    run = surefoot.simulate("empty_room", planner=Still, seconds=2.0, settings=ONE_CAMERA)
    assert run.trajectory is not None
    assert np.ptp(run.trajectory.poses[:, 0]) < 0.02
    assert f'planner = "{__name__}:Still"' in run.path("config.toml").read_text()


def test_a_planner_without_a_member_is_named():
    class Half:
        """Lacks most members."""

        def __init__(self, config, goals):
            """Takes what a planner takes."""

    with pytest.raises(surefoot.InputError, match=r"Half.*lacks reached"):
        surefoot.simulate("empty_room", planner=Half, seconds=1.0)


def test_unknown_names_are_refused():
    with pytest.raises(surefoot.InputError, match="planner 'serch' is unknown"):
        surefoot.simulate(planner="serch")
    with pytest.raises(surefoot.InputError, match="unknown key"):
        surefoot.process(WALK, settings={"grid.cell": 0.1})
    with pytest.raises(surefoot.InputError, match="no such file"):
        surefoot.process(WALK / "nothing")
    with pytest.raises(surefoot.InputError, match="does not exist"):
        surefoot.Run(WALK / "nothing")


@pytest.mark.parametrize("verb", ["map", "panorama", "monocular"])
def test_the_offline_verbs_return_their_runs(verb, pages):
    settings = {
        "map": {"surface.voxel_m": 0.08},
        "panorama": {"panorama.most_views": 3},
        "monocular": {},
    }
    with pages():
        run = getattr(surefoot, verb)(WALK, settings=settings[verb])
    assert run.summary["kind"] == verb
    assert run.summary["frames"] > 0
    assert run.report.is_file()
    if verb == "map":
        assert run.path("mesh.ply").is_file()
        assert run.layers["traversability"].shape == run.layers["elevation"].shape
        assert run.trajectory is not None
        assert run.map is not None
