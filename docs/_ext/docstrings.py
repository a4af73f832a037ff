"""Makes the project's docstrings fit for Sphinx, and writes the pages of the library and of the rooms.

Docstrings are plain text with `names` in backticks; what reStructuredText would read as markup is escaped.
"""

from __future__ import annotations

import ast
import re
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = {
    "perception": "what is there, with which uncertainty",
    "mapping": "what is remembered",
    "planning": "what to do",
    "sim": "a world to test in",
    "surefoot/evaluation": "how right it was, and whether it knew",
}
GROUPS = {
    "Functions on arrays": (
        "find_floor", "find_regions", "find_stairs", "find_obstacles", "find_footprints", "stereo_depth", "gaze_map",
        "find_path",
    ),
    "Objects that live from frame to frame": ("Pipeline", "Tracker"),
    "Whole runs": ("simulate", "process", "map", "panorama", "monocular", "evaluate", "Run"),
    "Values": (
        "Camera", "Plane", "Pose2", "Pose3", "Gaussian", "Landmark", "Region", "Staircase", "Obstacle", "Detection",
        "Footprint", "Cluster", "RobotModel", "WorldModel", "Config",
    ),
    "Sensor data": ("Frame", "DepthView", "RangeView", "StereoView", "ColourView", "StepOdometry", "Imu", "Depth"),
    "Plug-ins": (
        "Planner", "Decision", "WalkCommand", "GazeCommand", "GazePolicy", "MotionModel", "Innovation", "DepthSource",
        "Recording", "RecordingInfo",
    ),
    "Errors": ("SurefootError", "InputError", "RecordingError", "OutputError"),
}  # fmt: skip
VALUES = ("property", "attribute", "data")
HIDDEN = "\ue000"
CODE = re.compile(r"(`[^`\n]+`)")


def setup(app: Any) -> dict[str, bool]:
    """Write the pages, and watch the docstrings."""
    app.connect("builder-inited", _write_pages)
    for step, priority in (
        (_escape, 300),
        (_hide_colons, 400),
        (_show_colons, 600),
    ):  # napoleon: 500
        app.connect("autodoc-process-docstring", step, priority=priority)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _hide_colons(app: Any, what: str, name: str, item: Any, options: Any, lines: list[str]) -> None:
    """Of values, and of what is returned: else napoleon takes what stands before a colon for a type."""
    hide = what in VALUES
    for number, line in enumerate(lines):
        if line and not line[0].isspace():
            hide = what in VALUES or line.strip() in ("Returns:", "Yields:")
            if what not in VALUES:
                continue
        if hide:
            lines[number] = line.replace(":", HIDDEN)


def _show_colons(app: Any, what: str, name: str, item: Any, options: Any, lines: list[str]) -> None:
    lines[:] = [line.replace(HIDDEN, ":") for line in lines]


def _escape(app: Any, what: str, name: str, item: Any, options: Any, lines: list[str]) -> None:
    """Escape `|`, `*`, `_` and "(a)" outside of code."""
    for number, line in enumerate(lines):
        parts = CODE.split(line)
        for at in range(0, len(parts), 2):
            parts[at] = re.sub(r"([|\\])", r"\\\1", parts[at])
            parts[at] = re.sub(r"(?<!^)\*", r"\\*", parts[at])
            parts[at] = re.sub(r"(\w)_(?=\W|$)", r"\1\\_", parts[at])
        lines[number] = re.sub(r"^\((\w)\)", r"\\(\1)", "".join(parts))


def _write_pages(app: Any) -> None:
    """One page for the library, one for each room."""
    folder = Path(app.srcdir) / "api"
    folder.mkdir(exist_ok=True)
    pages = {"library.rst": _library()}
    listed = []
    for package, question in PACKAGES.items():
        rooms = sorted(p for p in (ROOT / package).iterdir() if (p / "__init__.py").is_file())
        listed.append(
            f"\n## {package.replace('/', '.')}: {question}\n\n```{{toctree}}\n:maxdepth: 1\n"
        )
        for room in [*rooms, ROOT / package]:
            modules = sorted(_modules(room, deep=room != ROOT / package))
            if not modules:
                continue
            name = ".".join(room.relative_to(ROOT).parts)
            pages[f"{name}.rst"] = _room(name, modules)
            listed.append(name)
        listed.append("```\n")
    pages["index.md"] = INDEX + "\n".join(listed)
    for name, text in pages.items():
        page = folder / name
        if not page.is_file() or page.read_text(encoding="utf-8") != text:
            page.write_text(text, encoding="utf-8")
    for page in folder.iterdir():
        if page.name not in pages:
            page.unlink()


INDEX = """# Programming interface

[The library](library.rst) is what `import surefoot` gives: start there. The rooms below hold the algorithms; the theory pages link
to them, equation by equation.

```{toctree}
:maxdepth: 1
library
```
"""


def _modules(folder: Path, deep: bool = False) -> list[str]:
    """Dotted names of the modules with docstrings for readers: no kernels."""
    files = folder.rglob("*.py") if deep else folder.glob("*.py")
    found = [p for p in files if p.stem != "__init__" and not p.stem.startswith("_")]
    return [".".join(p.relative_to(ROOT).with_suffix("").parts) for p in found]


def _library() -> str:
    import surefoot

    lines = [_head("Library", "="), "", "What ``import surefoot`` gives.", ""]
    lines += ["Lengths are in m, angles in rad, time in s. Body and map frames have z up, x ahead and y left; camera",
              "frames x right, y down, z ahead. ``T_a_b`` maps points of frame b to frame a.", ""]  # fmt: skip
    for title, names in GROUPS.items():
        lines += [_head(title, "-"), ""]
        for name in names:
            item = getattr(surefoot, name)
            kind = "class" if isinstance(item, type) else "function"
            lines.append(f".. auto{kind}:: surefoot.{name}")
            if not item.__module__.startswith("surefoot."):
                lines.append("   :no-index:")  # its room has it too
            lines.append("")
    return "\n".join(lines)


def _room(name: str, modules: list[str]) -> str:
    place = ROOT.joinpath(*name.split("."))
    opening = (
        ast.get_docstring(ast.parse((place / "__init__.py").read_text(encoding="utf-8"))) or ""
    )
    lines = [_head(name, "="), "", *_plain(opening), ""]
    for module in modules:
        lines += [_head(module, "-"), "", f".. automodule:: {module}", ""]
    return "\n".join(lines)


def _plain(text: str) -> list[str]:
    lines = text.splitlines()
    _escape(None, "", "", None, None, lines)
    return lines


def _head(text: str, line: str) -> str:
    return f"{text}\n{line * len(text)}"
