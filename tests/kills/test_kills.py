"""Two kills of a run, one of them while it closes; `make kills` kills every verb as often as one likes."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def test_a_killed_run_goes_on_to_the_same_files_and_leaves_no_process():
    words = [sys.executable, str(Path(__file__).with_name("kills.py")), "2", "3", "process"]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "process closing" in done.stdout
    assert "same" in done.stdout
