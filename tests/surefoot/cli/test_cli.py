"""The command line: bad input is one line and exit code 2; help is quick and complete."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import cv2
import numba
import numpy as np
import pytest
from click.testing import CliRunner

from surefoot.cli.main import main
from surefoot.cli.terminal import BAD_INPUT, FAILED, Progress, progress

VERBS = (
    "simulate",
    "process",
    "panorama",
    "monocular",
    "evaluate",
    "experiment",
    "bench",
    "view",
    "doctor",
    "completion",
)


def call(*words: object) -> tuple[int, str]:
    """Exit code and everything that was printed."""
    result = CliRunner().invoke(main, [str(word) for word in words])
    return result.exit_code, result.output


def plain_folder(folder: Path, depth: np.ndarray | None = None, text: str | None = None) -> Path:
    """A folder of one depth image with its description."""
    (folder / "depth").mkdir(parents=True)
    if depth is None:
        depth = np.full((48, 64), 1000, np.uint16)
    cv2.imwrite(str(folder / "depth" / "000000.png"), depth)
    description = (
        "[camera]\nwidth = 64\nheight = 48\nfx = 60.0\nfy = 60.0\ncx = 31.5\ncy = 23.5\n"
        "[depth]\nscale_per_metre = 1000.0\nnone = [0]\n"
    )
    (folder / "recording.toml").write_text(description if text is None else text)
    return folder


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_explains_itself(verb):
    code, shown = call(verb, "--help")
    assert code == 0
    assert "Usage" in shown


def test_help_does_not_load_the_heavy_packages():
    code = (
        "import sys\nfrom surefoot.cli.main import main\n"
        "heavy = {'numpy', 'open3d', 'cv2', 'numba', 'gtsam', 'pybullet', 'matplotlib', 'scipy'}\n"
        "print(sorted(heavy & set(sys.modules)))"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("simulate", "hoem"), "home"),
        (("simulate", "home", "--set", "grid.cel_m=0.05"), "cell_m"),
        (("simulate", "home", "--set", "grid.cell_m=wide"), "cell_m"),
        (("simulate", "home", "--set", "grid.cell_m=-1"), "cell_m"),
        (("simulate", "home", "--set", "nonsense"), "nonsense"),
        (("simulate", "home", "--set", "renderer='gpu'"), "renderer"),
        (("simulate", "--config", "no/such.toml"), "such.toml"),
        (("process", "no/such/folder"), "no such file or folder"),
        (("evaluate", "no/such/run"), "does not exist"),
        (("view", "no/such/run"), "does not exist"),
        (("experiment", "003-E99"), "unknown"),
        (("bench", "warp"), "unknown"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(words, said):
    code, shown = call(*words)
    assert code == BAD_INPUT, shown
    assert said in shown
    assert len(shown.strip().splitlines()) == 1, shown


@pytest.mark.parametrize(
    "words", [("simulate", "--seed", "-1"), ("experiment", "home", "--seeds", "0")]
)
def test_an_impossible_number_is_refused_by_its_name(words):
    code, shown = call(*words)
    assert code == BAD_INPUT
    assert words[-2] in shown


def test_an_unknown_key_in_a_file_is_named_with_the_file(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text("[guard]\nmargn_m = 0.1\n")
    code, shown = call("simulate", "--config", path)
    assert code == BAD_INPUT
    assert "margn_m" in shown
    assert "mine.toml" in shown


def test_a_folder_without_any_valid_depth_is_refused(tmp_path):
    folder = plain_folder(tmp_path / "empty", np.zeros((48, 64), np.uint16))
    code, shown = call("process", folder, "--out", tmp_path / "run")
    assert code == BAD_INPUT
    assert "empty" in shown.splitlines()[-1]


def test_an_output_that_is_somebody_elses_folder_is_not_touched(tmp_path):
    folder = plain_folder(tmp_path / "frames")
    taken = tmp_path / "thesis"
    taken.mkdir()
    (taken / "chapter1.tex").write_text("precious")
    code, shown = call("process", folder, "--out", taken)
    assert code == FAILED
    assert "thesis" in shown
    assert sorted(p.name for p in taken.iterdir()) == ["chapter1.tex"]


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_read_only_output_is_named(tmp_path):
    folder = plain_folder(tmp_path / "frames")
    locked = tmp_path / "locked"
    locked.mkdir(mode=0o500)
    code, shown = call("process", folder, "--out", locked / "run")
    assert code == FAILED
    assert "locked" in shown


def test_an_experiment_prints_its_table_or_one_object():
    code, shown = call("experiment", "004-E2", "--seeds", "1")
    assert code == 0
    assert "Table 5" in shown
    assert "passed" in shown
    code, shown = call("experiment", "004-E2", "--seeds", "1", "--json")
    assert code == 0
    assert json.loads(shown[shown.index("{") :])["passed"] is True
    code, shown = call("experiment", "004-E2", "--body", "dynamic")
    assert code == 2
    assert "nothing walks" in shown


def test_experiments_are_listed_with_their_titles():
    code, shown = call("experiment")
    assert code == 0
    assert "real-floor" in shown


def test_the_package_runs_as_a_module_under_its_own_name():
    done = subprocess.run(
        [sys.executable, "-m", "surefoot", "nonsense"], capture_output=True, text=True
    )
    assert done.returncode == BAD_INPUT
    assert "Usage: surefoot" in done.stderr


def test_the_completion_script_knows_the_program():
    code, shown = call("completion", "bash")
    assert code == 0
    assert "_SUREFOOT_COMPLETE" in shown


def test_doctor_says_what_each_missing_piece_costs():
    code, shown = call("doctor", "--json")
    findings = json.loads(shown)
    assert code == 0
    assert {"python", "open3d"} <= {finding["name"].split()[0].lower() for finding in findings}


def test_a_compilation_is_announced_once_and_a_compiled_kernel_is_not(capsys):
    double = numba.njit(lambda x: 2 * x)
    with progress():
        double(1)
        double(1.5)
    assert capsys.readouterr().err.count("compiling kernels") == 1
    with progress():
        double(2)
    assert capsys.readouterr().err == ""


def test_progress_into_a_file_is_sparse_and_never_among_the_results(capsys, monkeypatch):
    clock = [0.0]
    monkeypatch.setattr("surefoot.cli.terminal.time.monotonic", lambda: clock[0])
    say = Progress()
    for k in range(1000):
        clock[0] = 0.05 * k
        say(f"{k} of 1000")
    told = capsys.readouterr()
    assert told.out == ""
    assert [line.split()[0] for line in told.err.splitlines()] == ["0", "200", "400", "600", "800"]
