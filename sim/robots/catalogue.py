"""The robots: descriptions by name or from a user's file, read and checked.

Lengths are in m, angles in deg. Every key is checked: an error names the file, the key and what was expected. The
descriptions beside this module are ours; a user's own file is given by its path. `docs/howto/robots.md` lists all keys.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from perception.primitives import safe_input
from perception.primitives.errors import ConfigError, InputError
from perception.primitives.robot_model import GaitLimits, HeadLimits, RobotModel, StepLimits
from perception.primitives.safe_input import UnreadableError

from ..scenes.scene_table import TableReader
from .description import AXES, SENSORS, Description, Dynamic, Gaze, Legs, Sensor, Walk

OWN = "surefoot"
"""The robot of this project, which needs no description."""

EXAMPLE = "[legs]\nleft = [six joints, from the hip down]"
KEYS: dict[str, tuple[str, ...]] = {
    "": ("title", "licence", "origin", "package", "urdf", "turn_deg", "posture", "legs", "body", "gait",
         "steps", "camera", "gaze", "dynamic", "odometry", *SENSORS),
    "legs": ("left", "right", "feet", "sole_m", "sole_size_m"),
    "body": ("height_m", "width_m", "depth_m", "radius_m", "passage_m"),
    "gait": ("hip_m", "com_m", "stance_m", "narrowest_m", "lift_m", "single_support_s", "double_support_s"),
    "steps": ("cruise_mps", "max_mps", "back_mps", "side_mps", "turn_deg", "up_m", "down_m", "reach_m"),
    "camera": ("frame", "axis", "at_m", "eye_m"),
    "gaze": ("pan", "tilt", "pan_deg", "tilt_deg", "speed_radps"),
    "dynamic": ("contact_x_m", "contact_y_m", "inward_m", "start_s", "step_m", "slew_m", "ankle_gain", "ankle_rate_s",
                "shift_mps", "shift_forget_s", "touch_share", "hold_m", "wait_s"),
    "odometry": ("slip_m", "slip_sigma_m", "lateral_slip_m", "lateral_slip_sigma_m", "drift_sigma_deg", "step_x_sigma_m",
                 "step_y_sigma_m", "step_yaw_sigma_deg", "still_sigma_m", "still_sigma_deg"),
    "tof": ("width", "height", "across_deg", "down_deg", "at_m"),
    "depth": ("width", "height", "across_deg", "down_deg", "baseline_m", "noise_px", "at_m"),
    "stereo": ("width", "height", "across_deg", "baseline_m", "at_m"),
    "colour": ("width", "height", "across_deg", "at_m"),
}  # fmt: skip


DEPTH = ("tof", "depth", "stereo")
OPTIONAL = ("dynamic", "odometry", *SENSORS)
LEAST_DEG = 4.0  # ours: of a view or of a range of joints; no angle in rad is larger than 3.15
FASTEST_RADPS = 20.0  # ours: of a gaze; three times as fast as servos


def names() -> tuple[str, ...]:
    """Names of the robots that are described here, without `OWN`."""
    return tuple(sorted(path.stem for path in Path(__file__).parent.glob("*.toml")))


def load(name: str) -> Description:
    """The description of a robot by name, or from a path that ends in .toml.

    Raises:
        ConfigError: The name is unknown.
        InputError: The file cannot be read, or a value in it is impossible.
    """
    if name.endswith(".toml"):
        return read(Path(name))
    if name not in names():
        known = (OWN, *names())
        near = difflib.get_close_matches(name, known, n=1)
        hint = f"did you mean {near[0]!r}? " if near else ""
        raise ConfigError(
            f"robot: model={name!r} is unknown; {hint}choose {', '.join(known)}, or your own .toml file"
        )
    return read(Path(__file__).parent / f"{name}.toml")


def read(path: Path) -> Description:
    """The description in a file; errors as of `load`."""
    try:
        content = safe_input.toml(safe_input.text(path))
    except UnreadableError as error:
        raise InputError(f"{path}: {error}; expected the description of a robot") from error
    tables = _tables(path, content)
    try:
        return _description(path, TableReader(path, EXAMPLE), content, tables)
    except ConfigError as error:
        raise InputError(f"{path}: {error}") from error


def _tables(path: Path, content: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """All tables of the file, empty where it has none, without unknown keys."""
    found = {}
    for name, known in KEYS.items():
        table = content if not name else content.get(name, {})
        if not isinstance(table, dict):
            raise InputError(f"{path}: {name} = {table!r}; expected a table [{name}]")
        for key in table:
            if key not in known:
                near = difflib.get_close_matches(key, known, n=1)
                hint = f"did you mean {near[0]!r}?" if near else f"known: {', '.join(known)}"
                where = f"[{name}] " if name else ""
                raise InputError(f"{path}: {where}key {key!r} is unknown; {hint}")
        if name and name not in OPTIONAL and not table:
            raise InputError(f"{path}: no table [{name}]; expected {', '.join(known)}")
        found[name] = table
    if not any(found[name] for name in DEPTH):
        raise InputError(
            f"{path}: no table of a camera that measures depth; expected [tof], [depth] or [stereo]"
        )
    for one, other in (("dynamic", "odometry"), ("odometry", "dynamic")):
        if found[one] and not found[other]:
            raise InputError(
                f"{path}: no table [{other}] beside [{one}]; expected {', '.join(KEYS[other])}"
            )
    return found


def _description(
    path: Path, file: TableReader, content: dict[str, Any], tables: dict[str, dict[str, Any]]
) -> Description:
    posture = content.get("posture", {})
    if not isinstance(posture, dict):
        raise file.refusal("posture", posture, "a table of angles by joint, deg")
    angles = [file.number(posture, joint, None, -360.0, 360.0) for joint in posture]
    turned = [angle for angle in map(abs, angles) if angle]
    if len(turned) > 1 and max(turned) <= math.pi:
        raise file.refusal("posture", posture, "deg; these may be rad, since none is beyond 3.15")
    gaze, model, legs = _gaze(file, tables), _model(file, tables), _legs(file, tables["legs"])
    reach_m = model.height_m / 2.0
    walk = Walk(
        *(
            file.number(tables["gait"], key, None, 0.001, 3.0)
            for key in ("com_m", "stance_m", "narrowest_m", "lift_m")
        )
    )
    _refuse_contradictions(file, model, walk)
    return Description(
        path,
        file.word(content, "title"),
        file.word(content, "licence"),
        file.word(content, "origin"),
        file.word(content, "package") if "package" in content else "",
        file.word(content, "urdf"),
        file.number(content, "turn_deg", 0.0, -180.0, 180.0),
        tuple(zip(posture, map(math.radians, angles), strict=True)),
        legs,
        walk,
        gaze,
        model,
        tuple(
            (name, _sensor(file, name, tables[name], reach_m)) for name in SENSORS if tables[name]
        ),
        _dynamic(file, tables["dynamic"], tables["odometry"]) if tables["dynamic"] else None,
    )


def _dynamic(file: TableReader, table: dict[str, Any], odometry: dict[str, Any]) -> Dynamic:
    """How it walks in a physics engine, and the noise of its step odometry."""

    def span(key: str) -> tuple[float, float]:
        low, high = (float(v) for v in file.numbers(table, key, 2, -1.0, 1.0))
        if not low < high:
            raise file.refusal(key, table[key], "the smaller number first")
        return low, high

    noise, step_m = [], file.number(table, "step_m", None, 0.01, 1.0)
    for key in KEYS["odometry"]:
        angle = key.endswith("_deg")
        most = 90.0 if angle else step_m
        value = file.number(odometry, key, None, 0.0 if "sigma" in key else -most, most)
        noise.append((f"{key[:-4]}_rad", math.radians(value)) if angle else (key, value))
    numbers = {
        key: file.number(table, key, None, least, most)
        for key, least, most in (
            ("inward_m", -0.1, 0.1),
            ("start_s", 0.1, 5.0),
            ("slew_m", 0.001, 1.0),
            ("ankle_gain", 0.0, 2.0),
            ("ankle_rate_s", 0.0, 1.0),
            ("shift_mps", 0.0, 2.0),
            ("shift_forget_s", 0.01, 100.0),
            ("touch_share", 0.001, 0.5),
            ("hold_m", 0.0, 0.2),
            ("wait_s", 0.0, 2.0),
        )
    }
    return Dynamic(
        span("contact_x_m"), span("contact_y_m"), step_m=step_m, odometry=tuple(noise), **numbers
    )


def _legs(file: TableReader, table: dict[str, Any]) -> Legs:
    left, right = (_words(file, table, key, 6) for key in ("left", "right"))
    if both := set(left) & set(right):
        raise file.refusal("right", min(both), "joints that are not those of the left leg")
    feet = _words(file, table, "feet", 2)
    length, width = (float(v) for v in file.numbers(table, "sole_size_m", 2, 0.01, 1.0))
    x, y, z = (float(v) for v in file.numbers(table, "sole_m", 3, -1.0, 1.0))
    return Legs(left, right, (feet[0], feet[1]), (x, y, z), (length, width))


def _gaze(file: TableReader, tables: dict[str, dict[str, Any]]) -> Gaze:
    camera, gaze = tables["camera"], tables["gaze"]
    axis = file.word(camera, "axis", "x")
    if axis not in AXES:
        raise file.refusal("axis", axis, f"one of {', '.join(AXES)}")
    return Gaze(
        file.word(gaze, "pan"),
        file.word(gaze, "tilt"),
        file.word(camera, "frame"),
        axis,
        _place(file, camera, file.number(tables["body"], "height_m", None, 0.01, 5.0) / 2.0),
    )


def _model(file: TableReader, tables: dict[str, dict[str, Any]]) -> RobotModel:
    body, gait, steps, gaze = (tables[name] for name in ("body", "gait", "steps", "gaze"))

    def length(table: dict[str, Any], key: str, least: float = 0.01) -> float:
        return file.number(table, key, None, least, 5.0)

    def speed(key: str, least: float) -> float:
        return file.number(steps, key, None, least, 5.0)

    sole = file.numbers(tables["legs"], "sole_size_m", 2)
    highest, lowest = file.numbers(gaze, "tilt_deg", 2)
    if 0.0 < lowest - highest < LEAST_DEG:
        raise file.refusal("tilt_deg", gaze["tilt_deg"], f"a range of at least {LEAST_DEG:g} deg")
    return RobotModel(
        radius_m=length(body, "radius_m"),
        width_m=length(body, "width_m"),
        depth_m=length(body, "depth_m"),
        height_m=length(body, "height_m"),
        passage_width_m=length(body, "passage_m"),
        foot_m=(float(sole[0]), float(sole[1])),
        eye_m=length(tables["camera"], "eye_m"),
        hip_m=length(gait, "hip_m", 0.05),
        stance_m=length(gait, "stance_m"),
        steps=StepLimits(
            *(file.number(steps, key, 0.0, 0.0, 2.0) for key in ("up_m", "down_m", "reach_m"))
        ),
        gait=GaitLimits(
            speed("cruise_mps", 0.001),
            speed("max_mps", 0.001),
            speed("back_mps", 0.0),
            speed("side_mps", 0.0),
            file.number(steps, "turn_deg", None, 2.0, 90.0),
            file.number(gait, "single_support_s", None, 0.25, 5.0),
            file.number(gait, "double_support_s", None, 0.02, 5.0),
        ),
        head=HeadLimits(
            file.number(gaze, "pan_deg", None, LEAST_DEG, 180.0),
            (float(highest), float(lowest)),
            file.number(gaze, "speed_radps", None, 0.01, FASTEST_RADPS),
        ),
    )


def _refuse_contradictions(file: TableReader, model: RobotModel, walk: Walk) -> None:
    """Refuse lengths that are right one by one, and cannot be those of one robot."""
    half = max(model.width_m, model.depth_m) / 2.0
    for key, value, least, other, most in (
        ("radius_m", model.radius_m, half, "half of width_m and depth_m", math.inf),
        ("passage_m", model.passage_width_m, model.width_m, "width_m", math.inf),
        ("narrowest_m", walk.narrowest_m, model.foot_m[1], "the width of a sole", math.inf),
        ("stance_m", model.stance_m, walk.narrowest_m, "narrowest_m", math.inf),
        ("sole_size_m", model.foot_m[0], 0.0, "hip_m", model.hip_m),
        ("lift_m", walk.lift_m, 0.0, "hip_m", model.hip_m),
        ("hip_m", model.hip_m, 0.0, "height_m", model.height_m),
        ("com_m", walk.com_m, 0.0, "height_m", model.height_m),
        ("eye_m", model.eye_m, 0.0, "height_m", model.height_m),
    ):
        if value < least:
            raise file.refusal(key, value, f"at least {least:g}, {other}")
        if value > most:
            raise file.refusal(key, value, f"at most {most:g}, {other}")


def _sensor(file: TableReader, name: str, table: dict[str, Any], reach_m: float) -> Sensor:
    def of(key: str, wanted: bool, most: float, least: float = 0.001) -> float:
        return file.number(table, key, None, least, most) if wanted else 0.0

    return Sensor(
        file.count(table, "width", 0, 4096),
        file.count(table, "height", 0, 4096),
        file.number(table, "across_deg", None, LEAST_DEG, 169.0),
        _place(file, table, reach_m),
        of("down_deg", name in ("tof", "depth"), 169.0, LEAST_DEG),
        of("baseline_m", name in ("depth", "stereo"), 1.0),
        of("noise_px", name == "depth", 10.0),
    )


def _place(file: TableReader, table: dict[str, Any], most_m: float) -> tuple[float, float, float]:
    x, y, z = (
        (float(v) for v in file.numbers(table, "at_m", 3, -most_m, most_m))
        if "at_m" in table
        else (0.0,) * 3
    )
    return x, y, z


def _words(file: TableReader, table: dict[str, Any], key: str, count: int) -> tuple[str, ...]:
    value = table.get(key)
    good = isinstance(value, list) and all(isinstance(word, str) and word for word in value)
    if not good or not isinstance(value, list) or len(set(value)) != count or len(value) != count:
        raise file.refusal(key, value, f"a list of {count} different names")
    return tuple(value)
