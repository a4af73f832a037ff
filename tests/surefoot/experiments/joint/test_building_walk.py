"""The parts of the hour's walk: its log, its windows, and rooms against the scene."""

from __future__ import annotations

import itertools
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy import ndimage

from mapping.grid.rooms import find
from mapping.io import geotiff, world_file
from sim.free_space import clearance_map
from sim.scenes import catalogue
from surefoot.config.schema import Config
from surefoot.experiments.joint import building
from surefoot.experiments.support import experiment
from surefoot.experiments.support.long_walk import PARTS, WalkLog, long_walk, read_log
from surefoot.results.room_entries import ROOMS, room_entries
from surefoot.results.run_folder import RunFolder

SEED = 7  # the rule for doorways was chosen on seeds 100 to 103


@cache
def drawn():
    """A scene, and its true map as a perfect robot would draw it: the surfaces of walls and furniture are seen."""
    scene = catalogue.load("building", SEED)
    x0, y0, x1, y1 = scene.extent
    parts = [p for t in scene.static_objects if not t.name.startswith("tag") for p in t.parts]
    space = clearance_map((x0 - 0.2, y0 - 0.2, x1 + 0.2, y1 + 0.2), parts)
    x, y = space.centres.reshape(*space.clearance.shape, 2).transpose(2, 0, 1)
    free = (space.clearance >= 0.02) & (x > x0) & (x < x1) & (y > y0) & (y < y1)
    seen = ndimage.binary_dilation(free, np.ones((3, 3)), 2)
    probability = np.where(free, 0.03, 0.96).astype(np.float32)
    return scene, probability, seen, np.array([x0 - 0.2, y0 - 0.2])


@pytest.fixture
def folder(tmp_path):
    return RunFolder.create(tmp_path / "run")


def figures_of(folder, entries, seen=None):
    scene, probability, known, origin = drawn()
    known = known if seen is None else known & seen
    layer = np.where(known, probability, np.float32(np.nan))
    geotiff.save(folder.root / world_file.LAYERS, {"occupancy": layer}, origin, 0.05)
    folder.write_json(ROOMS, entries)
    return building.room_figures(folder, scene)


@cache
def entries():
    _, probability, seen, origin = drawn()
    return room_entries(find(probability, seen, origin, 0.05))


def test_the_rooms_of_a_true_map_are_those_of_the_scene(folder):
    figures = figures_of(folder, entries())
    assert figures["rooms_seen"] == 22.0
    assert figures["rooms_found_share"] >= 0.9
    assert figures["room_iou"] >= 0.8
    assert abs(figures["rooms_too_many"]) <= 2.0
    assert figures["doors_found"] >= 19.0
    assert figures["door_width_rmse_m"] < 0.1


def test_rooms_that_nobody_parted_are_not_found(folder):
    one = {
        **entries()["rooms"][0],
        "outline_m": [[0.0, 0.0], [14.4, 0.0], [14.4, 13.7], [0.0, 13.7]],
    }
    figures = figures_of(folder, {"rooms": [one], "doors": [], "floors": [[1]]})
    assert figures["rooms_found_share"] == 0.0
    assert figures["room_iou"] < 0.2
    assert np.isnan(figures["door_width_rmse_m"])


def test_rooms_that_were_not_seen_are_not_asked_for(folder):
    _, _, known, _ = drawn()
    south = np.zeros_like(known)
    south[: round(2.7 / 0.05)] = True  # the first row
    figures = figures_of(folder, {"rooms": [], "doors": [], "floors": []}, south)
    assert figures["rooms_seen"] == 5.0
    assert figures["rooms_found_share"] == 0.0


def test_the_picture_shows_rooms_and_doorways(folder):
    figures_of(folder, entries())
    (picture,) = building.picture_of(folder)
    assert (
        "Rooms: 22" in picture.sentence
        or "Rooms: 23" in picture.sentence
        or "Rooms: 21" in picture.sentence
    )
    assert "±" in picture.sentence
    axes = picture.draw().axes[0]
    assert len(axes.patches) == len(entries()["rooms"])
    assert len(axes.lines) == len(entries()["doors"])


def test_parts_of_a_walk_are_sixths_without_its_warm_up():
    stamps = np.linspace(0.3, 3600.0, 12_000)
    log = WalkLog(stamps, stamps, stamps, stamps)
    parts = [log.part(k) for k in range(PARTS)]
    assert stamps[parts[0]][0] == pytest.approx(60.3, abs=0.3)
    assert parts[-1] == log.part(-1)
    assert parts[-1].stop == len(stamps)
    assert all(a.stop == b.start for a, b in itertools.pairwise(parts))
    assert stamps[parts[5]][0] == pytest.approx(3000.0, abs=0.5)


def test_a_walk_logs_time_and_memory_of_every_cycle(tmp_path):
    config = Config(scene="home", seed=2)
    robot = replace(config.robot, stereo=False, colour=False, tof_source="rays")
    config = replace(config, robot=robot, mission=replace(config.mission, time_limit_s=3.0))
    said: list[str] = []
    run = long_walk(config, tmp_path / "walk", said.append)
    log = read_log(run)
    assert log.stamp_s.tolist() == run.read_csv("timing.csv").numbers("stamp_s").tolist()
    assert (log.busy_ms > 0.0).all()
    assert (log.rss_mb > 50.0).all()
    assert len(said) == 1
    whole = run.read_csv("truth/obstacles.csv")
    assert set(whole.numbers("stamp_s")) >= set(log.stamp_s.tolist())


def test_the_experiment_asks_for_what_was_promised():
    one = experiment.load("building")
    targets = {name: (t.relation, t.bound) for name, t in one.targets.items()}
    assert targets["cycle_p99_ratio"] == ("<=", 1.1)
    assert targets["position_rmse_m"] == ("<=", 0.05)
    assert targets["anees_in_band"] == ("==", 1.0)
    config = building.config_of(0, "kinematic", 60.0)
    assert config.mission.time_limit_s == 3600.0
    assert config.mission.goals >= len(catalogue.load("building", 0).goals)
