"""A run that is killed, at whatever moment, goes on where it was, to the same bits; or is refused with the reason."""

from __future__ import annotations

import dataclasses
import json
import os
import pickle
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from mcap.reader import make_reader

from perception.obstacles.track import Track
from perception.primitives import plugins
from perception.primitives.errors import InputError, OutputError
from surefoot.config.schema import Config
from surefoot.mcap_file import messages
from surefoot.recordings.identity import identity
from surefoot.results import object_file, run_folder
from surefoot.results.run_folder import RunFolder
from surefoot.run import checkpoint, process

WALK = Path(__file__).parents[3] / "data" / "walk"
FRAMES = 3  # of the short recording
DIFFERENT = (
    "timing.csv", "summary.json", "config.toml", ".surefoot-run", "estimates.mcap", "frames.parquet",
)  # fmt: skip
"""Files that name times or the folder itself."""


class Killed(BaseException):
    """As SIGKILL would, without a chance to tidy up."""


def quiet(text):
    pass


def killing(at):
    """A call that is killed the `at`-th time, counted from 1."""
    count = 0

    def call(*_):
        nonlocal count
        count += 1
        if count == at:
            raise Killed

    return call


def cut_at(folder, frame, recording=WALK):
    with pytest.raises(Killed):
        process.process(recording, None, Config(), folder, killing(frame))


def resumed(folder, recording=WALK):
    said = []
    process.process(recording, None, Config(), folder, said.append, resume=True)
    return said


def contents(folder):
    files = (file for file in folder.rglob("*") if file.is_file() and file.name not in DIFFERENT)
    return {file.relative_to(folder).as_posix(): file.read_bytes() for file in files}


def moments(folder):
    """Every message of the estimates but the wall times, and what its index says of the file."""
    found = []
    for topic, message in messages(folder / "estimates.mcap"):
        data = message.data
        if topic == "/estimate/moment":
            data = {k: v for k, v in json.loads(data).items() if k != "timing_ms"}
        found.append((topic, message.log_time, message.sequence, data))
    with (folder / "estimates.mcap").open("rb") as file:
        counts = make_reader(file).get_summary().statistics.channel_message_counts
    return found, counts


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    """A few frames of the walk, as a recording."""
    from surefoot.recordings.codec import encode
    from surefoot.recordings.mcap_format import RecordingWriter
    from surefoot.recordings.open import open_recording

    path = tmp_path_factory.mktemp("short") / "recording.mcap"
    walk = open_recording(WALK)
    with RecordingWriter(path, walk.info) as writer:
        for number, frame in enumerate(walk.frames()):
            if number == FRAMES:
                break
            writer.write(encode(frame))
    return path


def test_a_run_that_was_killed_gives_what_an_undisturbed_one_gives(tmp_path, monkeypatch):
    process.process(WALK, None, Config(), tmp_path / "whole", quiet)
    monkeypatch.setattr(checkpoint, "EVERY_S", 0.0)
    cut_at(tmp_path / "cut", 20)
    with next((tmp_path / "cut").glob(".part-floor*")).open("a") as torn:
        torn.write("half a row that was written after the checkp")
    assert resumed(tmp_path / "cut")[0] == "resuming after frame 20"
    assert contents(tmp_path / "cut") == contents(tmp_path / "whole")
    assert "terrain.npz" in contents(tmp_path / "cut")
    assert moments(tmp_path / "cut") == moments(tmp_path / "whole")
    assert not list((tmp_path / "cut").glob(".checkpoint*"))


def test_the_replacement_of_an_interrupted_run_is_told(short, tmp_path, monkeypatch):
    monkeypatch.setattr(checkpoint, "EVERY_S", 0.0)
    cut_at(tmp_path, 2, short)
    said: list[str] = []
    process.process(short, None, Config(), tmp_path, said.append)
    assert said[0].endswith("the interrupted run is replaced; --resume would have continued it")


def test_a_run_that_was_killed_while_closing_resumes_too(short, tmp_path, monkeypatch):
    process.process(short, None, Config(), tmp_path / "whole", quiet)
    whole = contents(tmp_path / "whole")
    replace, phase = os.replace, 0
    while True:  # killed before each renaming after the last frame, until the run completes
        phase += 1
        folder = tmp_path / str(phase)
        said: list[str] = []

        def renamed(source, target, said=said, dying=killing(phase)):  # noqa: B008
            if len(said) == FRAMES:
                dying()
            replace(source, target)

        monkeypatch.setattr(run_folder.os, "replace", renamed)
        try:
            process.process(short, None, Config(), folder, said.append)
            break
        except Killed:
            pass
        finally:
            monkeypatch.setattr(run_folder.os, "replace", replace)
        resumed(folder, short)
        assert contents(folder) == whole, phase
    assert phase > 15


@pytest.mark.parametrize("setting", [{"engine": "filterpy"}, {"lag_s": 5.0}])
def test_filters_by_filterpy_and_gtsam_resume_too(short, tmp_path, monkeypatch, setting):
    config = dataclasses.replace(
        Config(),
        localiser=dataclasses.replace(Config().localiser, **setting),
        tracker=dataclasses.replace(Config().tracker, hits_to_show=1),
    )
    process.process(short, None, config, tmp_path / "whole", quiet)
    monkeypatch.setattr(checkpoint, "EVERY_S", 0.0)
    with pytest.raises(Killed):
        process.process(short, None, config, tmp_path / "cut", killing(2))
    process.process(short, None, config, tmp_path / "cut", quiet, resume=True)
    assert contents(tmp_path / "cut") == contents(tmp_path / "whole")


@pytest.fixture(scope="module")
def cut(short, tmp_path_factory):
    """A killed run with a checkpoint."""
    folder = tmp_path_factory.mktemp("cut") / "run"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(checkpoint, "EVERY_S", 0.0)
        cut_at(folder, 2, short)
    return RunFolder(folder)


def test_a_checkpoint_of_something_else_is_refused(cut, short, tmp_path, monkeypatch):
    recorded = identity(short)
    other = dataclasses.replace(Config(), seed=1)
    with pytest.raises(InputError, match="made with another configuration; run without --resume"):
        checkpoint.load(cut, other, recorded)
    with pytest.raises(InputError, match="made of another recording"):
        checkpoint.load(cut, Config(), identity(WALK))
    monkeypatch.setattr(checkpoint, "version", lambda: "0.0.1")
    with pytest.raises(InputError, match="made by another version"):
        checkpoint.load(cut, Config(), recorded)
    assert checkpoint.load(RunFolder(tmp_path), Config(), recorded) is None


class Unkeepable(Track):
    """A user's motion model that keeps a function."""

    def __init__(self, *given):
        super().__init__(*given)
        self.function = lambda: None


def test_a_run_whose_plug_in_cannot_be_kept_goes_on_and_says_so(
    short, tmp_path, monkeypatch, caplog
):
    model = plugins.reference(Unkeepable)
    tracker = dataclasses.replace(Config().tracker, motion_model=model, hits_to_show=1)
    config = dataclasses.replace(Config(), tracker=tracker)
    monkeypatch.setattr(checkpoint, "EVERY_S", 0.0)
    process.process(short, None, config, tmp_path / "run", quiet)
    assert (tmp_path / "run" / "trajectory.txt").is_file()
    assert caplog.text.count("cannot be resumed") == 1


class Dangerous:
    def __reduce__(self):
        return (os.abort, ())


def test_a_forged_checkpoint_is_refused_and_runs_no_code(cut, short, tmp_path):
    recorded = identity(short)
    forged = RunFolder.create(tmp_path / "forged")
    whole = (cut.root / checkpoint.NAME).read_bytes()
    made_by = object_file.loads(whole)["made_by"]
    for content in (
        pickle.dumps(Dangerous()),
        whole[:-5],
        object_file.dumps({"made_by": made_by}),
        object_file.dumps({"made_by": made_by, "state": object_file.dumps(Config())}),
        object_file.dumps({"made_by": made_by, "state": object_file.dumps([RunFolder(Path("/"))])}),
        object_file.dumps([]),
    ):
        (forged.root / checkpoint.NAME).write_bytes(content)
        with pytest.raises(InputError, match="cannot resume"):
            checkpoint.load(forged, Config(), recorded)


def copied(cut, folder):
    shutil.copytree(cut.root, folder)
    return RunFolder(folder)


def test_a_prepared_folder_does_not_make_a_run_write_elsewhere(cut, short, tmp_path):
    mine = tmp_path / "mine.txt"
    mine.write_text("kept")
    run = copied(cut, tmp_path / "run")
    part = next(run.root.glob(".part-floor*"))
    part.unlink()
    part.symlink_to(mine)
    with pytest.raises(InputError, match=r"cannot resume: \.part-floor\.csv is a link"):
        checkpoint.load(run, Config(), identity(short))
    assert mine.read_text() == "kept"


@pytest.mark.parametrize("name", [".part-floor.csv", "estimates.mcap"])
def test_a_table_shorter_than_at_the_checkpoint_is_not_filled_up(cut, short, tmp_path, name):
    run = copied(cut, tmp_path / "run")
    with run.path(name).open("r+b") as file:
        file.truncate(20)
    with pytest.raises(InputError, match=r"cannot resume: its .* has lost its last"):
        checkpoint.load(run, Config(), identity(short))


def test_a_checkpoint_of_another_machine_is_good_wherever_the_files_lie(cut, short, tmp_path):
    moved = tmp_path / "elsewhere" / "recording.mcap"
    moved.parent.mkdir()
    shutil.copyfile(short, moved)
    run = copied(cut, tmp_path / "run")
    state = checkpoint.load(run, Config(), identity(moved))
    assert state is not None
    assert state.recorder.frames == 2


def test_two_processes_do_not_write_into_one_folder(tmp_path):
    folder = RunFolder.create(tmp_path / "run")
    folder.write_text("trajectory.txt", "kept")
    code = f"""
from pathlib import Path
from surefoot.results.run_folder import RunFolder
RunFolder.create(Path({str(folder.root)!r}))
"""
    other = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False
    )
    assert "another process writes into" in other.stderr
    assert folder.has("trajectory.txt")
    again = RunFolder.create(tmp_path / "run")
    del folder, again
    assert not subprocess.run([sys.executable, "-c", code], check=False).returncode
    with pytest.raises(OutputError, match="not the folder of a run"):
        RunFolder.held(tmp_path)


def test_recordings_are_told_apart(short, tmp_path):
    moved = tmp_path / "elsewhere" / "recording.mcap"
    moved.parent.mkdir()
    moved.write_bytes(short.read_bytes())
    assert identity(moved) == identity(short) == identity(moved.parent)
    moved.write_bytes(short.read_bytes()[:-1])
    assert identity(moved) != identity(short)
    folder = tmp_path / "images"
    (folder / "run").mkdir(parents=True)
    (folder / "a.png").write_bytes(b"one")
    first = identity(folder, None, folder / "run")
    (folder / "run" / "trajectory.txt").write_text("of a run")
    assert identity(folder, None, folder / "run") == first
    assert identity(folder) != first
    (folder / "a.png").write_bytes(b"two")
    assert identity(folder, None, folder / "run") != first
