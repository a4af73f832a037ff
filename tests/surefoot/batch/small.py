"""Tiny recordings, an executor that answers without work, and the workers of a process."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from surefoot.batch.job import Answer, Job
from surefoot.batch.places import current_identity
from surefoot.results.run_folder import MARK

DESCRIPTION = """\
rate_hz = 10.0
[camera]
width = 80
height = 60
fx = 70.0
fy = 70.0
cx = 39.5
cy = 29.5
[depth]
folder = "depth"
scale_per_metre = 1000
none = [0]
"""


def write_floor(folder: Path, frames: int = 2) -> None:
    """A camera 0.5 m above the floor, looking down by 30 degrees."""
    (folder / "depth").mkdir(parents=True)
    (folder / "recording.toml").write_text(DESCRIPTION)
    v = np.repeat(np.arange(60.0)[:, None], 80, axis=1)
    down = ((v - 29.5) / 70.0) * np.cos(np.radians(30)) + np.sin(np.radians(30))
    rng = np.random.default_rng(len(folder.name))
    for i in range(frames):
        noisy = 1000 * (0.5 / down + rng.normal(0, 0.003, v.shape))
        cv2.imwrite(str(folder / f"depth/{i}.png"), noisy.astype(np.uint16))


class Answering:
    """An executor whose jobs end at once, as a function of the job says; it keeps the names of what it was given."""

    def __init__(self, answer: Callable[[Job], Answer]) -> None:
        self.answer = answer
        self.given: list[str] = []
        self.open: list[Job] = []

    def room(self) -> bool:
        return len(self.open) < 2

    def submit(self, job: Job) -> None:
        self.given.append(job.name)
        self.open.append(job)

    def next(self) -> tuple[Job, Answer]:
        job = self.open.pop(0)
        return job, {"reason": "", "wall_s": 1.0, **self.answer(job)}

    def close(self) -> None:
        self.open.clear()


def made(job: Job) -> Answer:
    """The end of a job whose run is there."""
    target = Path(job.target)
    target.mkdir(parents=True, exist_ok=True)
    for name in (MARK, "report.html"):
        (target / name).write_text("1")
    (target / "summary.json").write_text('{"frames": 3}')
    return {"status": "done", "identity": current_identity(job), "figures": {"frames": 3.0}}


def children_of(pid: int) -> list[int]:
    """Worker processes of a process."""
    found = []
    for entry in filter(str.isdigit, os.listdir("/proc")):
        try:
            words = Path(f"/proc/{entry}/cmdline").read_text()
            parent = int(Path(f"/proc/{entry}/stat").read_text().rpartition(")")[2].split()[1])
        except OSError:
            continue
        if "surefoot.batch.worker" in words and parent == pid:
            found.append(int(entry))
    return found
