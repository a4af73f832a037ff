"""A recorder that is killed at any time leaves every frame that it has written."""

import contextlib
import multiprocessing
import time

import numpy as np

from surefoot.recordings.codec import decode, encode
from surefoot.recordings.mcap_format import McapRecording, RecordingWriter
from surefoot.recordings.recording import RecordingInfo

INFO = RecordingInfo(name="walk", kind="simulation")


def _record_until_killed(path, encoded, pipe):
    with RecordingWriter(path, INFO) as writer:
        for frame in encoded:
            writer.write(frame)
            pipe.send(frame.stamp_s)
            time.sleep(0.002)


def test_twenty_kills_lose_no_completely_written_frame(make_frame, same, tmp_path):
    """Recording time runs at 10 Hz here: a frame more than the last would be more than 0.1 s."""
    frames = [encode(make_frame(i)) for i in range(150)]
    rng = np.random.default_rng(2)
    context = multiprocessing.get_context("fork")
    for attempt, delay_s in enumerate(rng.uniform(0.02, 0.35, 20)):
        path = tmp_path / f"killed{attempt}.mcap"
        receive, send = context.Pipe(duplex=False)
        process = context.Process(target=_record_until_killed, args=(path, frames, send))
        process.start()
        send.close()
        written = [receive.recv()]  # the clock of the kill starts at the first frame
        time.sleep(delay_s)
        process.kill()
        process.join()
        with contextlib.suppress(EOFError):
            while True:
                written.append(receive.recv())
        recording = McapRecording(path)
        played = list(recording.frames())
        assert [frame.stamp_s for frame in played[: len(written)]] == written
        assert len(played) <= len(written) + 1
        assert same(played[-1], decode(frames[len(played) - 1]))
        assert bool(recording.remarks) == (len(written) < len(frames))
