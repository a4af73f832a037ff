"""The tables of a run hold what its files hold, and a run that was killed leaves complete tables or none."""

from __future__ import annotations

import math
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import duckdb
import numpy as np
import pytest

from surefoot.batch.job import PROCESS, Job
from surefoot.batch.work import figures_of
from surefoot.results.run_folder import RunFolder
from surefoot.store.run_metrics import metrics_row
from surefoot.store.run_tables import write_run_tables
from surefoot.store.schema import COMMIT, PLANE, POSE, TABLES

from .make_runs import make_run


def asked(run, sql):
    """Rows of a question to the tables of a run; {frames} is the file of that table."""
    files = {name: f"'{run.root}/tables/{name}.parquet'" for name in TABLES}
    return duckdb.sql(sql.format(**files)).fetchall()


def test_every_table_has_the_columns_and_types_of_the_schema(run):
    write_run_tables(run)
    for name, columns in TABLES.items():
        described = asked(run, f"DESCRIBE SELECT * FROM {{{name}}}")
        assert [row[:2] for row in described] == [(one.name, one.kind) for one in columns]


def test_frames_hold_pose_covariance_error_and_time(run):
    write_run_tables(run)
    rows = asked(
        run, f"SELECT stamp_s, x_m, y_m, qw, {', '.join(POSE)}, error_m, total_ms FROM {{frames}}"
    )
    expected = [[k, 0.1 * k, 0.01, 1.0, 4e-4, 0, 0, 1e-4, 0, 9e-4, 0.01, 5.0] for k in range(4)]
    np.testing.assert_allclose(rows, expected, atol=1e-9)
    assert asked(run, "SELECT state, ahead_m FROM {frames} LIMIT 1") == [(None, None)]


def test_other_tables_hold_what_the_files_hold(run):
    write_run_tables(run)
    assert asked(run, "SELECT schema, version, \"commit\", scene, seed, planner, notes FROM {runs}") == [
        (1, "0.1.0", "abc", "home", 0, "search", ["one", "two"])
    ]  # fmt: skip
    assert asked(run, "SELECT forward_m, turn_rad FROM {steps}") == [(0.1, 0.2)]
    assert asked(run, "SELECT why, tilt_rad, risk FROM {decisions}") == [("straight on", 0.3, None)]
    assert asked(run, "SELECT value FROM {config} WHERE setting = 'mission.planner'") == [
        ('"search"',)
    ]
    assert len(asked(run, "SELECT * FROM {floors} WHERE state = 'seen'")) == 3
    covariance = np.arange(16.0).reshape(4, 4) + np.arange(16.0).reshape(4, 4).T
    assert asked(run, "SELECT P_xx, P_xvy, P_yvx, P_vyvy FROM {tracks} LIMIT 1") == [
        (covariance[0, 0], covariance[0, 3], covariance[1, 2], covariance[3, 3])
    ]
    assert asked(run, "SELECT vx_mps, height_m, modes FROM {tracks} WHERE track = 2") == [
        (3.0, None, {"still": 0.8, "straight": 0.2})
    ]


def test_the_figures_of_a_run_follow_from_its_tables(run):
    row = metrics_row(run)
    assert row["floor_share"] == 0.75
    assert row["tilt_sigma_deg"] == pytest.approx(0.5)  # the larger axis, turned by 45 deg
    assert (row["tracks"], row["movers"], row["false_movers"]) == (2, 1, None)
    assert (row["skipped"], row["ate_m"], row["pose_nees"]) == (3, 0.02, 2.0)
    write_run_tables(run)
    assert asked(
        run, "SELECT figures['pose_consistent'], figures['pose_anees'] FROM {metrics}"
    ) == [(1.0, 6.0)]


def test_the_same_run_gives_the_same_bytes(run):
    def written():
        write_run_tables(run)
        return {path.name: path.read_bytes() for path in run.path("tables").iterdir()}

    assert written() == written()


def test_a_run_that_lacks_files_has_fewer_tables(run):
    write_run_tables(run)
    run.path("obstacles.json").unlink()
    run.path("commands.csv").unlink()
    write_run_tables(run)
    left = {path.stem for path in run.path("tables").iterdir()}
    assert left == set(TABLES) - {"tracks", "steps", "decisions"}


def test_a_killed_run_has_no_tables(run):
    run.path("summary.json").rename(run.path(".part-summary.json"))
    assert write_run_tables(run) is None
    assert not run.path("tables").exists()


def test_floor_planes_keep_their_covariance(run):
    write_run_tables(run)
    (row,) = asked(run, f"SELECT {', '.join(PLANE)} FROM {{floors}} LIMIT 1")
    larger = np.linalg.eigvalsh([[row[0], row[1]], [row[1], row[3]]])[-1]
    assert math.degrees(math.sqrt(larger)) == pytest.approx(0.5)


WRITER = """
import sys
from pathlib import Path
from surefoot.results.run_folder import RunFolder
from surefoot.store.run_tables import write_run_tables
run = RunFolder(Path(sys.argv[1]))
write_run_tables(run)
print("written", flush=True)
while True:
    write_run_tables(run)
"""


def test_a_writer_that_is_killed_leaves_tables_that_can_be_read(run):
    for delay_s in (0.013, 0.037):
        writer = subprocess.Popen(
            [sys.executable, "-c", WRITER, str(run.root)], stdout=subprocess.PIPE
        )
        assert writer.stdout is not None
        writer.stdout.readline()
        time.sleep(delay_s)
        os.kill(writer.pid, signal.SIGKILL)
        writer.wait()
        writer.stdout.close()
        assert RunFolder(run.root).has(COMMIT)
        for name in TABLES:
            assert asked(run, f"SELECT count(*) FROM {{{name}}}")[0][0] > 0


def test_the_page_of_outputs_lists_every_column():
    page = (Path(__file__).parents[3] / "docs" / "outputs.md").read_text(encoding="utf-8")
    listed = dict(re.findall(r"^\| `(\w+)` \| [^|]+ \| (.*) \|$", page, re.MULTILINE))
    for name, columns in TABLES.items():
        assert [one.name for one in columns if f"`{one.name}`" not in listed[name]] == []


def test_the_ate_of_tables_and_batches_is_that_of_the_metrics(tmp_path):
    run = make_run(tmp_path / "walk")
    run.write_json("metrics.json", {"position_rmse_m": 0.05, "position_rmse_3d_m": 0.06, "ate_m": 0.01})  # fmt: skip
    row = metrics_row(run)
    batch = figures_of(Job("walk", PROCESS, "", str(run.root)))
    assert (row["ate_m"], row["position_rmse_m"]) == (0.01, 0.05)
    assert (batch["ate_m"], batch["position_rmse_m"]) == (0.01, 0.05)
