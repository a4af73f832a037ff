"""Datasets for learning: they follow the published format, and their rows are those of the runs."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import duckdb
import numpy as np
import pytest
from click.testing import CliRunner

from perception.primitives.errors import InputError, OutputError
from surefoot.cli.main import main
from surefoot.results.run_folder import RunFolder
from surefoot.store.lerobot import export
from surefoot.store.schema import PLANE

from .make_runs import COVARIANCE, make_run

TYPES = {"float32": "FLOAT", "float64": "DOUBLE", "int64": "BIGINT"}
OWN = {"timestamp": "float32", "frame_index": "int64", "episode_index": "int64", "index": "int64", "task_index": "int64"}  # fmt: skip
STATS = {"min", "max", "mean", "std", "count", "q01", "q10", "q50", "q90", "q99"}
DESCRIPTION = """\
rate_hz = 1.0
[camera]
width = 8
height = 6
fx = 7.0
fy = 7.0
cx = 3.5
cy = 2.5
[depth]
folder = "depth"
scale_per_metre = 1000
none = [0]
"""


def depth_mm(k):
    """The depth image of frame k, mm; one pixel has none."""
    image = (1000 + 100 * k + np.arange(48).reshape(6, 8)).astype(np.uint16)
    image[2, 3] = 0
    return image


@pytest.fixture
def runs(tmp_path):
    """Two runs of four and six frames over a recording of depth images."""
    recording = tmp_path / "recording"
    (recording / "depth").mkdir(parents=True)
    (recording / "recording.toml").write_text(DESCRIPTION)
    for k in range(6):
        cv2.imwrite(str(recording / f"depth/{k}.png"), depth_mm(k))
    made = [make_run(tmp_path / f"run-{n}", frames=n, recording="digest") for n in (4, 6)]
    for run in made:
        summary = json.loads(run.path("summary.json").read_text())
        run.write_json("summary.json", summary | {"recording": str(recording)})
    return made


def rows(root, columns):
    return duckdb.sql(f"SELECT {columns} FROM '{root}/data/*/*.parquet' ORDER BY index").fetchall()


def check(root: Path) -> dict:
    """Every demand of the published format v3.0 on the files; returns meta/info.json."""
    info = json.loads((root / "meta/info.json").read_text(encoding="utf-8"))
    assert info["codebase_version"] == "v3.0"
    assert info["splits"] == {"train": f"0:{info['total_episodes']}"}
    episodes = duckdb.sql(
        f"SELECT * FROM '{root}/meta/episodes/*/*.parquet' ORDER BY episode_index"
    )
    listed = [dict(zip(episodes.columns, row, strict=True)) for row in episodes.fetchall()]
    assert [one["episode_index"] for one in listed] == list(range(info["total_episodes"]))
    assert listed[-1]["dataset_to_index"] == info["total_frames"]
    features = info["features"]
    assert {name: features[name]["dtype"] for name in OWN} == OWN
    assert not any("/" in name for name in features)
    first = 0
    for one in listed:
        place = {"chunk_index": one["data/chunk_index"], "file_index": one["data/file_index"]}
        data = duckdb.sql(f"SELECT * FROM '{root / info['data_path'].format(**place)}'")
        types = dict(zip(data.columns, map(str, data.types), strict=True))
        assert set(types) == set(features)
        for name, feature in features.items():
            if feature["dtype"] == "image":
                assert types[name].replace(chr(34), "") == "STRUCT(bytes BLOB, path VARCHAR)"
                assert len(feature["shape"]) == 3
                assert feature["names"] == ["height", "width", "channels"]
            elif feature["shape"] == [1]:
                assert types[name] == TYPES[feature["dtype"]]
            else:
                assert types[name] == f"{TYPES[feature['dtype']]}[]"
                assert len(feature["names"]) == feature["shape"][0]
                lengths = duckdb.sql(f'SELECT DISTINCT len("{name}") FROM data').fetchall()
                assert lengths == [(feature["shape"][0],)]
        count = one["length"]
        found = duckdb.sql(
            "SELECT timestamp, frame_index, index FROM data ORDER BY index"
        ).fetchall()
        expected = [(k / info["fps"], k, first + k) for k in range(count)]
        np.testing.assert_allclose(found, expected, atol=1e-6)
        assert (one["dataset_from_index"], one["dataset_to_index"]) == (first, first + count)
        first += count
        for name in features:
            assert {
                key.rsplit("/", 1)[1] for key in one if key.startswith(f"stats/{name}/")
            } == STATS
    stats = json.loads((root / "meta/stats.json").read_text(encoding="utf-8"))
    assert {name: set(stats[name]) for name in stats} == dict.fromkeys(features, STATS)
    tasks = duckdb.sql(
        f"SELECT task_index, task FROM '{root}/meta/tasks.parquet' ORDER BY 1"
    ).fetchall()
    assert [number for number, _ in tasks] == list(range(info["total_tasks"]))
    named = {task for one in listed for task in one["tasks"]}
    assert named == {task for _, task in tasks}
    (index,) = duckdb.sql(
        f"SELECT decode(value) FROM parquet_kv_metadata('{root}/meta/tasks.parquet') WHERE decode(key) = 'pandas'"
    ).fetchall()[0]
    assert json.loads(index)["index_columns"] == ["task"]
    return info


def test_a_dataset_follows_the_published_format(runs, tmp_path):
    info = check(export(runs, tmp_path / "set", print))
    assert info["total_episodes"] == 2
    assert info["total_frames"] == 10
    assert info["fps"] == 1
    assert info["features"]["observation.depth"]["shape"] == [6, 8, 1]


def test_the_rows_are_those_of_the_run(runs, tmp_path):
    root = export(runs[:1], tmp_path / "set", print)
    found = rows(
        root, '"observation.state", "observation.pose_covariance", action, "observation.stamp_s"'
    )
    for k, (state, covariance, action, stamp_s) in enumerate(found):
        assert state == pytest.approx([0.1 * k, 0.01, 0.0, 0.0], abs=1e-6)
        assert covariance == pytest.approx(COVARIANCE[np.triu_indices(3)].tolist(), abs=1e-9)
        step = [0.0, 0.0, 0.0] if k == 0 else [0.1, 0.0, 0.2]  # the command of 1 s, held
        assert action == pytest.approx([*step, 0.0, 0.0 if k == 0 else 0.3], abs=1e-6)
        assert stamp_s == k
    floor = rows(root, '"observation.floor.depth"')[1][0]
    assert floor[:4] == pytest.approx([0.0, -1.0, 0.0, 0.5])
    assert floor[4 + PLANE.index("P22")] == pytest.approx(1e-6)
    (obstacles,) = rows(root, '"observation.obstacles"')[0]
    each = np.reshape(obstacles, (8, -1))
    assert each[:, 0].tolist() == [1.0, 1.0] + [0.0] * 6  # two tracks at 0 s
    assert each[0, 1:5].tolist() == [1.0, 2.0, 3.0, 4.0]


def test_without_commands_the_action_is_the_motion_to_the_next_row(runs, tmp_path):
    runs[0].path("commands.csv").unlink()
    found = rows(export(runs[:1], tmp_path / "set", print), "action")
    np.testing.assert_allclose(
        [one for (one,) in found], [[0.1, 0, 0]] * 3 + [[0, 0, 0]], atol=1e-6
    )


def test_depth_is_kept_to_the_millimetre(runs, tmp_path):
    root = export(runs[:1], tmp_path / "set", print)
    for k, (data,) in enumerate(rows(root, "\"observation.depth\"['bytes']")):
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
        np.testing.assert_array_equal(image, depth_mm(k))


def test_statistics_are_those_of_all_rows(runs, tmp_path):
    root = export(runs, tmp_path / "set", print)
    stats = json.loads((root / "meta/stats.json").read_text(encoding="utf-8"))["observation.state"]
    values = np.array([one for (one,) in rows(root, '"observation.state"')])
    for name, expected in (
        ("min", values.min(axis=0)), ("max", values.max(axis=0)), ("mean", values.mean(axis=0)), ("std", values.std(axis=0)),
    ):  # fmt: skip
        np.testing.assert_allclose(stats[name], expected, atol=1e-6)
    assert stats["count"] == [10]


def test_rows_are_evenly_spaced_where_frames_are_not(tmp_path):
    run = make_run(tmp_path / "run")
    stamps = [0.0, 0.1, 0.35, 0.4]
    run.write_trajectory("trajectory.txt", [(t, t, 0.0, 0.0, 0.0) for t in stamps])
    run.write_csv("timing.csv", ("stamp_s", "floor"), [(t, 1.0) for t in stamps])
    said = []
    root = export([run], tmp_path / "set", said.append, fps=10)
    found = rows(root, '"observation.stamp_s", "observation.state"[1]')
    np.testing.assert_allclose(found, [[t, t] for t in (0.0, 0.1, 0.1, 0.35, 0.4)], atol=1e-6)
    assert said == [f"{run.root}: no pictures, for it was not recorded (`simulate --record`)"]


def test_a_run_whose_clock_was_set_is_refused(tmp_path):
    run = make_run(tmp_path / "run")
    stamps = [0.0, 0.1, 0.2, 1.7e9]
    run.write_trajectory("trajectory.txt", [(t, 1.0, 0.0, 0.0, 0.0) for t in stamps])
    run.write_csv("timing.csv", ("stamp_s", "floor"), [(t, 1.0) for t in stamps])
    with pytest.raises(InputError, match=r"4 frames in 1.7e\+09 s would be 17000000001 rows"):
        export([run], tmp_path / "set", print)


def test_runs_that_do_not_fit_together_are_refused(runs, tmp_path):
    runs[1].path("floor.csv").unlink()
    with pytest.raises(InputError, match=r"observation\.floor\.depth differ"):
        export(runs, tmp_path / "set", print)
    assert not (tmp_path / "set").exists()
    assert not list(tmp_path.glob(".part-*"))
    (tmp_path / "taken").mkdir()
    (tmp_path / "taken/note").write_text("mine")
    with pytest.raises(OutputError, match="not empty"):
        export(runs[:1], tmp_path / "taken", print)
    empty = make_run(tmp_path / "empty")
    for name in ("trajectory.txt", "trajectory_covariance.csv"):
        empty.path(name).unlink()
    with pytest.raises(InputError, match="no poses"):
        export([RunFolder(empty.root)], tmp_path / "set", print)


def test_the_working_directory_may_become_the_dataset_if_it_is_empty(runs, tmp_path, monkeypatch):
    here = tmp_path / "here"
    here.mkdir()
    before = here.stat().st_ino
    monkeypatch.chdir(here)
    export(runs, Path(), print)
    assert sorted(one.name for one in here.iterdir()) == ["data", "meta"]
    assert here.stat().st_ino == before  # still that of the shell
    assert check(here)["total_episodes"] == len(runs)


def test_the_verb_writes_a_dataset(runs, tmp_path):
    words = ["export", str(runs[0].root), str(runs[1].root), "--lerobot", str(tmp_path / "set")]
    done = CliRunner().invoke(main, words)
    assert done.exit_code == 0, done.output
    assert check(tmp_path / "set")["total_episodes"] == 2
    assert (
        CliRunner().invoke(main, [*words[:3], "--layout", str(tmp_path / "a.json")]).exit_code == 2
    )
