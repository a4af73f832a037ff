"""One offline verb on one recording: its input, its folder, and the files that all verbs write.

Every folder holds config.toml, with which the verb gives the same result again, summary.json and report.html.
"""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..config import toml
from ..config.schema import Config
from ..recordings.identity import identity
from ..recordings.recording import Recording
from ..recordings.without_poses import WithoutPoses, open_input
from ..results.camera_trajectory import write_poses
from ..results.run_folder import RunFolder
from ..results.version import commit, version

TRUTH = "truth/trajectory.txt"


@dataclass(frozen=True)
class Job:
    """One verb on one recording.

    Args:
        verb: "map", "panorama" or "monocular".
        recording: The opened recording.
        folder: Output folder; config.toml is in it already.
        config: Everything the result depends on.
        path: Where the recording is; None for one that is not on disk.
        description: The recording.toml kept elsewhere, if there is one.
    """

    verb: str
    recording: Recording
    folder: RunFolder
    config: Config
    path: Path | None = None
    description: Path | None = None

    @staticmethod
    def of(verb: str, recording: Recording, config: Config, out: Path | None) -> Job:
        """A job on an opened recording; `out` as for `open`."""
        return _begin(Job, verb, recording, config, out, None, None)

    @staticmethod
    def open(
        verb: str, path: Path, description: Path | None, config: Config, out: Path | None
    ) -> Job:
        """Open a recording and make the output folder.

        Args:
            verb: "map", "panorama" or "monocular".
            path: File or folder of the recording.
            description: A recording.toml kept elsewhere; None looks beside the data.
            config: Everything the result depends on.
            out: Output folder; None takes the next free runs/<name>-<verb>-<n>.

        Raises:
            RecordingError: The recording cannot be read.
            OutputError: The folder cannot be written.
        """
        recording = open_input(path, description, config.ignore_poses, config.reader)
        return _begin(Job, verb, recording, config, out, path, description)

    @property
    def command(self) -> str:
        """The command line that gives the same result again."""
        words = ["surefoot", self.verb, str(self.path or "RECORDING")]
        words += ["--config", str(self.folder.path("config.toml"))]
        if self.description is not None:
            words += ["--description", str(self.description)]
        return shlex.join(words)

    def finish(self, frames: int, skipped: dict[str, int], **figures: Any) -> dict[str, Any]:
        """Write the truth, summary.json, report.html and the tables.

        Args:
            frames: How many frames were used.
            skipped: Number of frames that could not be used, by reason.
            figures: Further entries of the summary.

        Returns:
            The summary.
        """
        from ..report.page import write_report
        from ..store.run_tables import write_run_tables

        keep_truth(self.folder, self.recording, self.path)
        summary = {
            "kind": self.verb,
            "name": self.recording.info.name,
            "command": self.command,
            "recording": "" if self.path is None else str(self.path),
            "version": version(),
            "commit": commit(),
            "frames": frames,
            "skipped": skipped,
            "notes": list(self.recording.remarks),
            **figures,
        }
        if self.path is not None:
            summary["recording_identity"] = identity(self.path, self.description, self.folder.root)
        self.folder.write_json("summary.json", summary)
        write_report(self.folder)
        write_run_tables(self.folder)
        return summary


def _begin(
    kind: type[Job],
    verb: str,
    recording: Recording,
    config: Config,
    out: Path | None,
    path: Path | None,
    description: Path | None,
) -> Job:
    folder = RunFolder.create(out, name=f"{recording.info.name}-{verb}", reads=path)
    folder.write_text("config.toml", toml.dumps(config))
    return kind(verb, recording, folder, config, path, description)


def keep_truth(folder: RunFolder, recording: Recording, path: Path | None) -> None:
    """Put the truth of a recording into the folder: the poses that were ignored, or the truth/ beside it."""
    if isinstance(recording, WithoutPoses):
        write_poses(folder, TRUTH, recording.poses.items())
    elif path is not None:
        folder.adopt_truth(path)


def count_reasons(reasons: list[str]) -> dict[str, int]:
    """How often each reason occurs, in alphabetical order."""
    return {reason: reasons.count(reason) for reason in sorted(set(reasons))}
