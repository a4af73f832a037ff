"""The command line: bad input is one line and exit code 2; help is quick and complete."""

from __future__ import annotations

import errno
import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import cv2
import numba
import numpy as np
import pytest
from click.testing import CliRunner

from perception.primitives.errors import OutputError
from surefoot.cli import terminal
from surefoot.cli.main import main
from surefoot.cli.terminal import BAD_INPUT, FAILED, INTERRUPTED, Progress, exit_code, progress
from surefoot.config import toml
from surefoot.config.schema import Config
from surefoot.recordings.identity import identity
from surefoot.store.query import asker

SCHEMAS = Path(__file__).resolve().parents[3] / "docs" / "schemas"


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


@pytest.mark.parametrize("verb", main.commands)
def test_every_verb_explains_itself_with_an_example(verb):
    code, shown = call(verb, "--help")
    assert code == 0
    usage, *rest = shown.splitlines()
    assert "Usage" in usage
    assert any(line.startswith(f"    surefoot {verb}") for line in rest), shown


def test_a_warning_is_a_plain_line():
    code = (
        "import logging\nfrom surefoot.cli.main import main\n"
        "main(['settings', '--help'], standalone_mode=False)\n"
        "logging.getLogger('planning.planners').warning('%.1f s: depth is back', 9.8)"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stderr == "warning: 9.8 s: depth is back\n"


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
        (("simulate", "home", "--set", "grid.cel_m=0.05"), "did you mean grid.cell_m?"),
        (("simulate", "home", "--set", "grid.cell_m=wide"), "cell_m"),
        (("simulate", "home", "--set", "grid.cell_m=-1"), "cell_m"),
        (("simulate", "home", "--set", "nonsense"), "nonsense"),
        (("simulate", "home", "--set", "renderer='gpu'"), "renderer"),
        (("simulate", "home", "--robot", "taloss"), "did you mean 'talos'?"),
        (("simulate", "home", "--robot", "no/such.toml"), "such.toml"),
        (
            (
                "simulate",
                "home",
                "--robot",
                "g1",
                "--body",
                "dynamic",
                "--set",
                "robot.dynamic.engine=mujoco",
            ),
            "model='g1' walks in 'pybullet'",
        ),
        (("simulate", "--config", "no/such.toml"), "such.toml"),
        (("process", "no/such/folder"), "no such file or folder"),
        (("evaluate", "no/such/run"), "does not exist"),
        (("view", "no/such/run"), "does not exist"),
        (("experiment", "003-E99"), "did you mean 003-E"),
        (("experiment", "sensor"), "did you mean sensors?"),
        (("batch", "process", "no/such/folder", "--out", "o"), "no such file or folder"),
        (
            ("batch", "process", "a", "--out", "o", "--set", "grid.cel_m=1"),
            "did you mean grid.cell_m?",
        ),
        (
            ("batch", "process", "a", "--out", "o", "--workers", "1", "--scheduler", "x"),
            "give one of them",
        ),
        (("simulate", "home", "--seeds", "1:2"), "--seeds needs --out"),
        (("process", "data/walk", "--resume"), "--resume needs --out"),
        (("bench", "warp"), "unknown"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(words, said):
    code, shown = call(*words)
    assert code == BAD_INPUT, shown
    assert said in shown
    assert len(shown.strip().splitlines()) == 1, shown


def test_the_robots_are_listed_with_their_licence_and_whether_they_are_there(monkeypatch):
    monkeypatch.setattr("sim.robots.installed.folder", lambda name: None)
    code, shown = call("robots", "--json")
    listed = {one["name"]: one for one in json.loads(shown)}
    assert code == 0
    assert listed.keys() == {"surefoot", "g1", "icub", "talos"}
    assert listed["icub"]["licence"] == "CC-BY-SA-4.0"
    assert [one["installed"] for one in listed.values()] == [True, False, False, False]
    code, shown = call("robots")
    lines = shown.strip().splitlines()
    assert (code, len(lines)) == (0, 4)
    assert sum("not installed: pip install 'surefoot[robots]'" in line for line in lines) == 3


@pytest.mark.parametrize(
    "words",
    [
        ("simulate", "--seed", "-1"),
        ("experiment", "home", "--seeds", "0"),
        *(("simulate", "--seeds", seeds) for seeds in ("7", "3:3", "-1:2", "a:b", ":")),
        ("batch", "process", "a", "--out", "o", "--memory", "nan"),
    ],
)
def test_an_impossible_number_is_refused_by_its_name(words):
    code, shown = call(*words)
    assert code == BAD_INPUT
    assert words[-2] in shown


READS = (
    "process", "map", "merge", "panorama", "monocular", "calibrate-noise", "smooth", "evaluate", "view", "replay", "film", "export",
)  # fmt: skip


@pytest.mark.parametrize("verb", READS)
def test_a_path_that_cannot_be_used_is_refused_in_one_line(verb, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "loop").symlink_to("loop")
    (tmp_path / "empty").mkdir()
    (tmp_path / "a file").write_text("x")
    os.mkfifo(tmp_path / "pipe")
    for path in (
        "",
        "loop",
        "a" * 5000,
        "a\0b",
        "empty",
        "a file",
        "pipe",
        "/dev/zero",
        "no/such",
        "ünï",
    ):
        code, shown = call(verb, "--", path)
        assert code == BAD_INPUT, (path, shown)
        assert len(shown.strip().splitlines()) == 1, (path, shown)
        assert shown.startswith("surefoot: ")
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize(
    "words",
    [("smooth", "--lag", "nan", "a"), ("process", "--smooth", "nan", "a"), ("smooth", "--lag", "-inf", "a"),
     ("evaluate", "--truth-sigma", "nan", "0", "a"), ("evaluate", "--truth-sigma", "0", "inf", "a"),
     ("map", "--voxel", "nan", "a"), ("simulate", "--difficulty", "nan"), ("simulate", "--wander", "nan")],
)  # fmt: skip
def test_what_is_no_number_is_refused(words):
    code, shown = call(*words)
    assert code == BAD_INPUT
    assert "nan" in shown or "inf" in shown


def test_what_the_system_refuses_is_one_line_and_no_fault_of_the_program(monkeypatch):
    for number, code in ((errno.EACCES, BAD_INPUT), (errno.EROFS, BAD_INPUT), (errno.ENOSPC, FAILED)):  # fmt: skip

        def refuse(number=number):
            raise OSError(number, os.strerror(number), "/a/b")

        monkeypatch.setattr("surefoot.cli.doctor.examine", refuse)
        assert call("doctor") == (code, f"surefoot: /a/b: {os.strerror(number)}\n")
    monkeypatch.setattr("surefoot.cli.doctor.examine", lambda: [][0])
    assert "unexpected IndexError" in call("doctor")[1]


@pytest.mark.parametrize(
    "words",
    [
        ("simulate", "empty", "--out", "bad\udcff"),
        ("simulate", "empty", "--set", "scene=\udcff"),
        ("batch", "process", "bad\udcff"),
    ],
)
def test_what_no_report_can_hold_is_refused_before_the_work(words):
    code, output = call(*words)
    assert code == BAD_INPUT
    assert r"\udcff' is not UTF-8; rename the file" in output


def test_an_unknown_key_in_a_file_is_named_with_the_file(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text("[grid]\ncel_m = 0.1\n")
    code, shown = call("simulate", "--config", path)
    assert code == BAD_INPUT
    assert "grid.cel_m; did you mean grid.cell_m?" in shown
    assert "mine.toml" in shown


def test_a_folder_without_any_valid_depth_is_refused(tmp_path):
    folder = plain_folder(tmp_path / "empty", np.zeros((48, 64), np.uint16))
    code, shown = call("process", folder, "--out", tmp_path / "run")
    assert code == BAD_INPUT
    assert "empty" in shown.splitlines()[-1]


def test_an_output_folder_with_other_files_is_not_touched(tmp_path):
    folder = plain_folder(tmp_path / "frames")
    taken = tmp_path / "thesis"
    taken.mkdir()
    (taken / "chapter1.tex").write_text("precious")
    code, shown = call("process", folder, "--out", taken)
    assert code == BAD_INPUT
    assert "thesis" in shown
    assert sorted(p.name for p in taken.iterdir()) == ["chapter1.tex"]


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_read_only_output_is_named(tmp_path):
    folder = plain_folder(tmp_path / "frames")
    locked = tmp_path / "locked"
    locked.mkdir(mode=0o500)
    code, shown = call("process", folder, "--out", locked / "run")
    assert code == BAD_INPUT
    assert "locked" in shown


def test_only_a_full_disk_is_no_fault_of_the_input():
    full = OutputError("full")
    full.__cause__ = OSError(errno.ENOSPC, "no space")
    assert exit_code(full) == FAILED
    assert exit_code(OutputError("not empty")) == BAD_INPUT


def test_an_experiment_prints_its_table_or_one_object(tmp_path):
    out = ("--out", tmp_path / "e2")
    code, shown = call("experiment", "004-E2", "--seeds", "20", *out)
    assert code == 0
    assert "Table 5" in shown
    assert "passed" in shown
    code, shown = call("experiment", "004-E2", "--seeds", "20", *out, "--json")
    assert code == 0
    assert json.loads(shown[shown.index("{") :])["passed"] is True
    code, shown = call("experiment", "004-E2", *out, "--body", "dynamic")
    assert code == 2
    assert "no robot walks" in shown


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


README = Path(__file__).parents[3] / "README.md"
WALK = README.parent / "data" / "walk"


def floor_folder(folder: Path, description: str, size: tuple[int, int], frames: int = 1) -> Path:
    """A camera 0.5 m above a bare floor, looking down by 30 degrees."""
    (folder / "depth").mkdir(parents=True)
    (folder / "recording.toml").write_text(description)
    width, height = size
    v = np.repeat(np.arange(float(height))[:, None], width, axis=1)
    slope = (v - (height - 1) / 2) / (0.82 * width)
    z = 0.5 / (slope * np.cos(np.radians(30)) + np.sin(np.radians(30)))
    rng = np.random.default_rng(0)
    for k in range(frames):
        noisy = np.clip(1000 * (z + rng.normal(0.0, 0.003, z.shape)), 0, 65535)
        cv2.imwrite(str(folder / "depth" / f"{k:04d}.png"), noisy.astype(np.uint16))
    return folder


def test_the_recording_toml_of_the_readme_works_as_pasted(tmp_path):
    blocks = re.findall(r"```toml\n(.*?)```", README.read_text(), re.DOTALL)
    (example,) = [block for block in blocks if "[depth]" in block]
    folder = floor_folder(tmp_path / "frames", example, (640, 480), frames=3)
    code, shown = call("process", folder, "--out", tmp_path / "run")
    assert code == 0, shown
    assert "floor seen in 3 of 3 frames" in shown
    assert "30 frames per second assumed" in shown


def test_a_panorama_says_which_frames_were_skipped(tmp_path):
    blocks = re.findall(r"```toml\n(.*?)```", README.read_text(), re.DOTALL)
    (example,) = [block for block in blocks if "[depth]" in block]
    folder = floor_folder(tmp_path / "frames", example, (640, 480), frames=3)
    (folder / "depth" / "0001.png").write_bytes(b"")
    _, shown = call("panorama", folder, "--out", tmp_path / "run")
    assert "skipped 1: depth image is an empty file\n" in shown


@pytest.mark.parametrize(
    ("verb", "words", "expected", "ends"),
    [
        ("map", ("--voxel", "0.08"), {"surface.voxel_m": 0.08}, 0),
        ("panorama", ("--views", "3"), {"panorama.most_views": 3}, 0),
        # the head looks elsewhere in each of three views, so that pictures alone cannot place them
        ("panorama", ("--by-pictures", "--views", "3"), {"panorama.by_pictures": True}, 1),
    ],
)
def test_a_run_repeats_from_its_config(tmp_path, verb, words, expected, ends, pages):
    out, again = tmp_path / "run", tmp_path / "again"
    with pages():
        code, shown = call(verb, WALK, "--out", out, *words)
    assert code == ends, shown
    assert ("only 1 of 3 views could be placed" in shown) == (ends == 1)
    config = toml.read(Config, out / "config.toml")
    for name, value in expected.items():
        table, key = name.split(".")
        assert getattr(getattr(config, table), key) == value
    summary = json.loads((out / "summary.json").read_text())
    assert summary["kind"] == verb
    assert summary["recording"] == str(WALK)
    assert summary["command"] == f"surefoot {verb} {WALK} --config {out / 'config.toml'}"
    assert (out / "report.html").is_file()
    with asker([out], print) as tables:
        asked = "SELECT kind, recording_hash, metrics.frames FROM runs JOIN metrics USING (run)"
        assert tables.ask(asked).rows == [(verb, identity(WALK), summary["frames"])]
    code, shown = call(*summary["command"].split()[1:], "--out", again)
    assert code == ends, shown
    name = {"map": "mesh.ply", "panorama": "panorama.json"}[verb]
    assert (again / name).read_bytes() == (out / name).read_bytes()


@pytest.mark.parametrize("verb", ["process", "map", "panorama"])
def test_every_verb_takes_a_description_kept_elsewhere(tmp_path, verb):
    folder = floor_folder(tmp_path / "frames", "", (80, 60))
    (folder / "recording.toml").unlink()
    elsewhere = tmp_path / "mine.toml"
    elsewhere.write_text(
        "[camera]\nwidth = 80\nheight = 60\nfx = 65.6\nfy = 65.6\ncx = 39.5\ncy = 29.5\n"
        "[depth]\nscale_per_metre = 1000\nnone = [0]\n"
    )
    code, shown = call(verb, folder, "--description", elsewhere, "--out", tmp_path / "run")
    assert code == 0, shown
    command = json.loads((tmp_path / "run" / "summary.json").read_text())["command"]
    assert command.endswith(f"--description {elsewhere}")


def test_ignored_poses_are_compared_with_the_estimate_at_the_end(recordings, tmp_path):
    kitchen = recordings / "sevenscenes_redkitchen" / "pan"
    code, shown = call("process", kitchen, "--ignore-poses", "--out", tmp_path / "run")
    assert code == 0, shown
    found = re.search(r"against the poses of the recording: ([0-9.]+) m", shown)
    assert float(found.group(1)) < 0.05
    assert (tmp_path / "run" / "truth" / "trajectory.txt").is_file()


def test_ctrl_c_ends_with_exit_code_130_and_the_command_that_continues(
    tmp_path, monkeypatch, ctrl_c
):
    count = 0

    def press(self, text):
        nonlocal count
        count += 1
        if count == 5:
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(Progress, "__call__", press)
    code, shown = call("process", WALK, "--out", tmp_path / "run")
    assert code == INTERRUPTED
    last = shown.strip().splitlines()[-1]
    assert last.startswith("interrupted after 5 frames; continue with: surefoot process ")
    code, shown = call(*last.partition(": surefoot ")[2].split())
    assert code == 0, shown
    assert "43 frames" in shown


def test_ctrl_c_elsewhere_exits_with_130(monkeypatch):
    def interrupt(*given):
        raise KeyboardInterrupt

    monkeypatch.setattr("surefoot.benchmarks.benchmark.names", interrupt)
    code, shown = call("bench")
    assert code == INTERRUPTED
    assert shown.strip() == "interrupted"


def test_ctrl_c_while_mapping_says_that_nothing_is_kept(monkeypatch, tmp_path):
    def interrupt(*given):
        raise KeyboardInterrupt

    monkeypatch.setattr("surefoot.offline.map.map_recording", interrupt)
    code, shown = call("map", WALK, "--out", tmp_path / "run")
    assert code == INTERRUPTED
    assert shown.strip() == "interrupted; the same command starts afresh"


def test_evaluating_a_folder_of_runs_points_to_batch(tmp_path):
    for name in ("monday", "tuesday"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "summary.json").write_text("{}")
    code, shown = call("evaluate", tmp_path)
    assert code == BAD_INPUT
    assert "the runs in it do (monday, tuesday)" in shown
    assert f"`surefoot batch evaluate {tmp_path} --out OUT` for all" in shown


def test_a_report_is_opened_quietly_and_only_on_a_desktop(tmp_path, monkeypatch):
    started = []
    monkeypatch.setattr(terminal.sys, "platform", "linux")
    monkeypatch.setattr(terminal.shutil, "which", lambda name: f"/usr/bin/{name}")
    monkeypatch.setattr(
        terminal.subprocess, "Popen", lambda words, **given: started.append((words, given))
    )
    for variable in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(variable, raising=False)
    (tmp_path / "summary.json").write_text("{}")
    (tmp_path / "report.html").write_text("report")
    assert call("view", tmp_path)[0] == 0
    assert not started
    monkeypatch.setenv("DISPLAY", ":0")
    assert call("view", tmp_path)[0] == 0
    ((words, given),) = started
    assert words == ["/usr/bin/xdg-open", str(tmp_path / "report.html")]
    assert given["stderr"] == terminal.subprocess.DEVNULL


def test_evaluate_judges_a_foreign_trajectory_and_says_the_factor(tmp_path, pages):
    rng = np.random.default_rng(0)
    n = 300
    stamps = 0.1 * np.arange(n)
    true = np.column_stack([np.cumsum(rng.normal(size=(n, 3)), axis=0) * 0.1])
    quats = np.tile([0.0, 0.0, 0.0, 1.0], (n, 1))
    np.savetxt(tmp_path / "true.txt", np.column_stack([stamps, true, quats]))
    found = true + 0.03 * rng.normal(size=(n, 3))
    np.savetxt(tmp_path / "found.txt", np.column_stack([stamps, found, quats]))
    np.savetxt(tmp_path / "cov.csv", np.tile(1e-4 * np.eye(3).ravel(), (n, 1)), delimiter=",")
    files = ("--trajectory", tmp_path / "found.txt", "--truth", tmp_path / "true.txt")
    claims = ("--covariance", tmp_path / "cov.csv", "--out", tmp_path / "out")
    with pages():
        code, shown = call("evaluate", *files, *claims)
    assert code == 0
    assert "claims: too sure by a factor of 3." in shown or "by a factor of 2.9" in shown
    assert "errors are taken to be independent" in shown
    metrics = json.loads((tmp_path / "out" / "metrics.json").read_text())
    assert metrics["sigma_factor"] == pytest.approx(3.0, rel=0.1)
    page = (tmp_path / "out" / "report.html").read_text()
    assert "too sure by a factor of" in page
    assert page.count("<svg") == 3 or page.count("image/svg+xml") == 3
    code, shown = call("evaluate", *files, "--out", tmp_path / "plain")
    assert (code, "accuracy only" in shown) == (0, True)


@pytest.mark.parametrize("name", ["summary", "metrics"])
def test_the_json_files_of_a_judged_trajectory_follow_their_schemas(tmp_path, name):
    jsonschema = pytest.importorskip("jsonschema")
    for file in ("found.txt", "true.txt"):
        rows = [[float(k), 0.1 * k, 0.01 * k**2, 0.0, 0.0, 0.0, 0.0, 1.0] for k in range(9)]
        np.savetxt(tmp_path / file, rows)
    files = ("--trajectory", tmp_path / "found.txt", "--truth", tmp_path / "true.txt")
    code, shown = call("evaluate", *files, "--out", tmp_path / "out")
    assert code == 0, shown
    content = json.loads((tmp_path / "out" / f"{name}.json").read_text(encoding="utf-8"))
    schema = json.loads((SCHEMAS / f"{name}.schema.json").read_text(encoding="utf-8"))
    validator = jsonschema.Draft202012Validator(schema)
    assert [error.message for error in validator.iter_errors(content)] == []
    if name == "summary":  # only a judged trajectory has no frames
        walk = content | {"kind": "simulation"}
        missing = [error.message for error in validator.iter_errors(walk)]
        assert missing == [f"{key!r} is a required property" for key in ("frames", "skipped")]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--trajectory", "a.txt"), "needs --truth"),
        (("run", "--trajectory", "a.txt", "--truth", "b.txt"), "neither a RUN"),
        (("run", "--covariance", "c.csv"), "belong to --trajectory"),
        ((), "give the folder of a RUN"),
    ],
)
def test_evaluate_refuses_options_that_do_not_go_together(words, message):
    code, shown = call("evaluate", *words)
    assert (code, message in shown) == (BAD_INPUT, True)


def test_evaluate_of_trajectories_of_different_times_is_bad_input(tmp_path):
    for name, start in (("found.txt", 0.0), ("true.txt", 50.0)):
        rows = [[start + k, 0.1 * k, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0] for k in range(9)]
        np.savetxt(tmp_path / name, rows)
    code, shown = call(
        "evaluate", "--trajectory", tmp_path / "found.txt", "--truth", tmp_path / "true.txt"
    )
    assert code == BAD_INPUT
    assert "50.000 to 58.000 s, the trajectory 0.000 to 8.000 s" in shown
