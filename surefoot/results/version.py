"""Which Surefoot made a result: version of the package, and commit of the checkout."""

from __future__ import annotations

import subprocess
from functools import cache
from importlib import metadata
from pathlib import Path


def version() -> str:
    """Version of the installed package, or "from source"."""
    try:
        return metadata.version("surefoot")
    except metadata.PackageNotFoundError:
        return "from source"


@cache
def commit() -> str:
    """Commit of the checkout that runs, with "+" if files differ from it; empty outside a checkout.

    It is asked once a process.
    """
    root = Path(__file__).parents[2]
    if not (root / ".git").exists():
        return ""

    def git(*words: str) -> str:
        done = subprocess.run(
            ["git", "-C", str(root), *words], capture_output=True, text=True, check=True, timeout=20
        )
        return done.stdout.strip()

    try:
        changed = git("status", "--porcelain", "--untracked-files=no")
        return git("rev-parse", "--short=12", "HEAD") + ("+" if changed else "")
    except (OSError, subprocess.SubprocessError):
        return ""
