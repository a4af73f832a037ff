"""Which modules a file imports, directly and through others; from this, which tests can notice a bug in a module.

Source: ours.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path


@cache
def imports(root: Path, path: Path) -> frozenset[Path]:
    """Files of the tree that a file imports, anywhere in it; a test also has the `conftest.py` of its folders."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            for alias in node.names:
                found |= set(_files(root, alias.name.split(".")))
        elif isinstance(node, ast.ImportFrom):
            base = node.module.split(".") if node.module else []
            start = path.parents[node.level - 1] if node.level else root
            for alias in node.names:
                found |= set(_files(start, [*base, alias.name])) or set(_files(start, base))
            if not node.level and path.is_relative_to(root / "tests"):  # a helper beside the test
                found |= set(_files(path.parent, base))
    if path.is_relative_to(root / "tests"):
        folders = [folder for folder in path.parents if folder.is_relative_to(root / "tests")]
        found |= {folder / "conftest.py" for folder in folders if folder != root / "tests"}
    return frozenset(file for file in found if file.is_file() and file != path)


def _files(start: Path, words: list[str]) -> Iterator[Path]:
    file = start.joinpath(*words).with_suffix(".py")
    if words and file.is_file():
        yield file


@cache
def distances(root: Path, path: Path) -> dict[Path, int]:
    """Number of imports from a file to each file that it reaches; 0 to itself."""
    found, edge, away = {path: 0}, {path}, 0
    while edge:
        away += 1
        edge = {other for file in edge for other in imports(root, file)} - found.keys()
        found |= dict.fromkeys(edge, away)
    return found


def tests_of(root: Path, module: Path) -> list[tuple[int, Path]]:
    """Tests that can notice a bug in a module, with their distance, the nearest first.

    These are the tests of its room that reach it, and tests elsewhere that import it themselves. Where there is
    neither, the nearest ones are taken. The test file with the module's name has the distance 0.
    """
    room = root / "tests" / module.parent.relative_to(root)
    name = f"test_{module.stem.strip('_')}"
    found = []
    for test in sorted((root / "tests").rglob("test_*.py")):
        away = distances(root, test).get(module)
        if away is not None:
            found.append((0 if test.stem == name else away, test))
    here = [(away, test) for away, test in found if away <= 1 or test.parent == room]
    least = min((away for away, _ in found), default=0)
    return sorted(here or [one for one in found if one[0] == least])
