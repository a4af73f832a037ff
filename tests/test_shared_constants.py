"""What estimation and planning assume of movers and of noise is not taken from the simulator in silence.

A number of theirs that equals, with its unit, one of the simulator's laws of movers or of its noise must say on its lines
where it comes from. That two numbers agree is no fault: a paper, a data sheet or a study may have given both.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LAWS = ("sim/movers", "sim/scenes/course.py")
NOISE = ("sim/body/kinematic.py", "sim/body/inertial.py", "sim/body/head.py", "sim/sensors")
ABOUT_MOVERS = (
    *("perception/obstacles", "perception/filtering"),
    *("planning/gaze", "planning/safety", "planning/univector"),
)
ABOUT_NOISE = (
    "perception/localisation",
    "perception/filtering",
    "perception/depth/time_of_flight.py",
)
LAW_UNITS, NOISE_UNITS = ("s", "mps", "mps2"), ("m", "mps2", "rad", "radps", "px")
ORIGIN = re.compile(
    r"seed \d{3}|et al|\b(19|20)\d\d\b|MEMS|SR-4000|MX-28|DARwIn|measured|trial|calibration|[Oo]urs:"
)

Quantity = tuple[str, float]
"""Unit and magnitude."""


def numbers(node: ast.expr) -> list[float]:
    """The numbers of a constant's value: a number, a tuple, `radians(...)` or `setting(...)`."""
    if isinstance(node, ast.Call):
        return numbers(node.args[0]) if node.args else []
    if isinstance(node, ast.Tuple):
        return [number for part in node.elts for number in numbers(part)]
    if isinstance(node, ast.UnaryOp):
        return numbers(node.operand)
    plain = isinstance(node, ast.Constant) and isinstance(node.value, (int, float))
    return [abs(float(node.value))] if plain and node.value else []


def quantities(source: str, units: tuple[str, ...]) -> Iterator[tuple[str, Quantity, str]]:
    """Name, quantity and lines of every constant and every default of a field that has one of the units."""
    tree, lines = ast.parse(source), source.splitlines()
    bodies = [tree.body, *(node.body for node in tree.body if isinstance(node, ast.ClassDef))]
    for node in (one for body in bodies for one in body):
        if not isinstance(node, (ast.Assign, ast.AnnAssign)) or node.value is None:
            continue
        target = node.targets[0] if isinstance(node, ast.Assign) else node.target
        name = ast.unparse(target).strip("()")
        unit = name.split(",")[0].lower().split("_")[-1].replace("deg", "rad")
        if unit in units:
            after = lines[node.end_lineno : node.end_lineno + 1]
            text = "\n".join(
                lines[node.lineno - 1 : node.end_lineno] + [a for a in after if '"""' in a]
            )
            for number in numbers(node.value):
                yield name, (unit, number), text


def sources(places: tuple[str, ...]) -> dict[str, str]:
    """The modules in these places, by path."""
    paths = [p for place in places for p in (ROOT / place, *(ROOT / place).rglob("*.py"))]
    return {str(p.relative_to(ROOT)): p.read_text() for p in paths if p.is_file()}


def silent(theirs: dict[str, str], simulator: dict[str, str], units: tuple[str, ...]) -> list[str]:
    """Constants that equal one of the simulator's and do not say where they come from."""
    known = {q for text in simulator.values() for _, q, _ in quantities(text, units)}
    return [
        f"{path}: {name} = {quantity[1]}"
        for path, text in theirs.items()
        for name, quantity, lines in quantities(text, units)
        if quantity in known and not ORIGIN.search(lines)
    ]


def test_no_number_about_movers_is_one_of_the_simulators_laws_without_an_origin():
    assert silent(sources(ABOUT_MOVERS), sources(LAWS), LAW_UNITS) == []


def test_no_number_about_noise_is_one_of_the_simulators_without_an_origin():
    assert silent(sources(ABOUT_NOISE), sources(NOISE), NOISE_UNITS) == []


def test_a_number_taken_over_in_silence_is_found():
    simulator = {"law": "PAUSE_S = (2.0, 17.5)\nSLIP_DEG: float = 0.35\n"}
    taken = "WAITS_S = 17.5  # ours\n\nclass A:\n    slip_rad: float = math.radians(0.35)\n"
    assert silent({"a": taken}, simulator, ("s", "rad")) == [
        "a: WAITS_S = 17.5",
        "a: slip_rad = 0.35",
    ]
    said = taken.replace("# ours", "# ours: pedestrians at lights, Smith 2010").replace(
        "(0.35)", "(0.35)  # seed 001"
    )
    assert silent({"a": said}, simulator, ("s", "rad")) == []
    assert silent({"a": "WAITS_M = 17.5\n"}, simulator, ("s", "rad")) == []  # another unit
