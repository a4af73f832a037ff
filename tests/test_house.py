"""The project itself: origin of packages, docstrings, import cycles, pinned versions."""

from __future__ import annotations

import ast
import importlib
import re
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("perception", "mapping", "planning", "sim", "surefoot")
LIBRARY = ROOT / "surefoot" / "__init__.py"  # the public library, which also refuses namesakes
MODULES = sorted(p for package in PACKAGES for p in (ROOT / package).rglob("*.py"))


def name(path: Path) -> str:
    """Path below the root, for test ids."""
    return str(path.relative_to(ROOT))


@pytest.mark.parametrize("package", PACKAGES)
def test_each_package_is_the_one_of_this_tree(package):
    found = importlib.import_module(package).__file__
    assert found is not None
    assert Path(found).resolve() == ROOT / package / "__init__.py"


@cache
def tree_of(path: Path) -> ast.Module:
    """A file as its syntax tree."""
    return ast.parse(path.read_text())


@pytest.mark.parametrize("path", MODULES, ids=name)
def test_every_module_says_what_it_is(path):
    tree = tree_of(path)
    assert ast.get_docstring(tree)
    if path.name == "__init__.py" and path != LIBRARY:
        assert len(tree.body) == 1, "an __init__.py holds a docstring and nothing else"


def test_no_module_replaces_one_of_the_standard_library():
    assert {path.stem for path in MODULES} & set(sys.stdlib_module_names) == set()


def test_every_public_function_and_class_is_described():
    silent = []
    for path in MODULES:
        if path.stem.endswith("_kernels"):
            continue
        for node in tree_of(path).body:
            described = (ast.FunctionDef, ast.ClassDef)
            public = isinstance(node, described) and not node.name.startswith("_")
            if public and not ast.get_docstring(node):
                silent.append(f"{name(path)}: {node.name}")
    assert silent == []


def test_versions_are_pinned_by_name_and_version_only():
    lines = (ROOT / "requirements.lock").read_text().splitlines()
    assert len(lines) > 50
    assert all(re.fullmatch(r"[A-Za-z0-9._-]+==[A-Za-z0-9.]+", line) for line in lines)


def test_no_file_names_the_host_of_a_package_index():
    listed = subprocess.run(
        ["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.split("\n")
    hosts = re.compile("|".join(("pypi" + r"\.org", "python" + "hosted", "extra-" + "index-url")))
    texts = [p for p in listed if p.endswith((".py", ".toml", ".md", ".lock", "Makefile", "run"))]
    assert [p for p in texts if (ROOT / p).is_file() and hosts.search((ROOT / p).read_text())] == []


def test_pybullet_hands_images_over_as_arrays():
    from sim import bullet

    assert bullet.library().isNumpyEnabled()


def test_every_kernel_takes_its_compiler_from_one_place():
    home = ROOT / "perception" / "primitives" / "compiled.py"
    others = [
        name(path)
        for path in MODULES
        if path != home and re.search(r"^from numba import .*njit", path.read_text(), re.MULTILINE)
    ]
    assert others == []


def imports(path: Path) -> set[str]:
    """Modules of this project that a file imports, anywhere in it."""
    here = module_of(path).split(".")
    package = here if path.name == "__init__.py" else here[:-1]
    found = set()
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.ImportFrom):
            base = ".".join(package[: len(package) - node.level + 1]) if node.level else ""
            base = ".".join(part for part in (base, node.module) if part)
            found |= {f"{base}.{alias.name}" for alias in node.names} | {base}
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
    return (found & KNOWN) - {module_of(path), *parents_of(module_of(path))}


def module_of(path: Path) -> str:
    """Dotted name of a file."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


KNOWN = {module_of(path) for path in MODULES}


def parents_of(module: str) -> list[str]:
    """The packages that contain a module."""
    parts = module.split(".")
    return [".".join(parts[:count]) for count in range(1, len(parts))]


def test_no_modules_import_each_other_in_a_circle():
    waiting = {module_of(path): imports(path) for path in MODULES if path != LIBRARY}
    while free := [module for module, needs in waiting.items() if needs.isdisjoint(waiting)]:
        for module in free:
            del waiting[module]
    assert waiting == {}, "these import each other, or what does"


DIRECT = {
    "json": {"load", "loads"}, "_json": {"load", "loads"}, "tomllib": {"load", "loads"}, "cv2": {"imread", "imdecode", "FileStorage"},
    "np": {"load", "loadtxt", "genfromtxt", "fromfile"}, "pickle": {"load", "loads", "dump", "dumps"},
}  # fmt: skip
"""Calls that trust what they read, or run it."""
OWN = {
    "perception/primitives/safe_input.py": "the one reader",
    "perception/primitives/mesh_reader.py": "what its own process says",
    "surefoot/offline/panorama.py": "what it has just written",
    "surefoot/report/replay/still.py": "what the page has just encoded",
    "surefoot/results/object_file.py": "within a file whose checksum is right",
}
"""Files that may, and why; studies read the recordings that they were written for."""


def trusting(path: Path) -> list[str]:
    """Calls in a file that read somebody's content without `safe_input`, or run code."""
    found = []
    for node in ast.walk(tree_of(path)):
        call = node.func if isinstance(node, ast.Call) else None
        if isinstance(call, ast.Name) and call.id in ("eval", "exec", "loadmat"):
            found.append(call.id)
        if isinstance(call, ast.Attribute) and isinstance(call.value, ast.Name):
            of = call.value.id
            if call.attr in DIRECT.get(of, ()) or (of == "yaml" and call.attr.startswith("load")):
                found.append(f"{of}.{call.attr}")
    return found


def test_content_of_others_is_read_in_one_place_and_never_run():
    for path in MODULES:
        room = name(path).split("/")[:2]
        if name(path) not in OWN and room not in (["surefoot", "experiments"], ["surefoot", "benchmarks"]):  # fmt: skip
            assert trusting(path) == [], name(path)
    for path in OWN:
        assert trusting(ROOT / path), f"{path} needs no exception"
