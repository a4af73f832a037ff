"""Descriptions: ours need no wheel, and a mistake is refused with its place and what was expected."""

import re
from importlib import metadata
from pathlib import Path

import pytest

from perception.primitives.errors import ConfigError, InputError
from perception.primitives.robot_model import RADIUS_M
from sim.robot_config import RobotConfig, grown
from sim.robots import catalogue, installed
from sim.robots.jointed import jointed

LITTLE = Path(__file__).resolve().parents[2] / "little_robot"
TEXT = (LITTLE / "little.toml").read_text()


@pytest.mark.parametrize("name", catalogue.names())
def test_our_descriptions_are_read_without_their_packages(name):
    robot = catalogue.load(name)
    model = robot.model
    assert (robot.title, robot.licence, robot.origin) != ("", "", "")
    assert len(set(robot.moving)) == 14
    assert RADIUS_M < model.radius_m < model.height_m < 2.0
    assert model.hip_m < robot.walk.com_m + 0.1 < model.eye_m < model.height_m
    config = grown(RobotConfig(model=name))
    assert config.gait.forward_limit_m == pytest.approx(
        model.gait.max_speed_mps * model.gait.step_s
    )
    assert (config.tof, config.depth) == (name != "g1", name == "g1")  # a D435, or time of flight
    assert (config.stereo, config.colour) == (False, True)


def test_what_a_description_says_reaches_the_models_of_gait_gaze_and_cameras():
    robot = catalogue.read(LITTLE / "little.toml")
    config = grown(RobotConfig(model=str(LITTLE / "little.toml")))
    assert robot.model.head.tilt_deg == config.head.tilt_deg == (15.0, 65.0)
    assert (config.gait.stance_width_m, config.gait.com_height_m) == (0.16, 0.5)
    assert (config.tof_camera.width, config.tof_camera.across_deg) == (106, 87.0)
    assert config.colour_camera.mount_m == (0.0, 0.015, 0.0)
    assert config.measures.trunk_m[:2] == (robot.model.depth_m, robot.model.width_m)
    assert config.walker.breadth == pytest.approx(robot.model.radius_m / RADIUS_M)


TOF = """[tof]
width = 106
height = 60
across_deg = 87
down_deg = 58
"""


def changed(tmp_path, old, new, times=1):
    assert old in TEXT
    (tmp_path / "little.urdf").write_text((LITTLE / "little.urdf").read_text())
    path = tmp_path / "mine.toml"
    path.write_text(TEXT.replace(old, new, times))
    return path


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("hip_m", "hips_m", "[gait] key 'hips_m' is unknown; did you mean 'hip_m'?"),
        ("com_m = 0.5\n", "", "com_m = None; expected a finite number"),
        ("hip_m = 0.45", "hip_m = 45", "hip_m = 45; expected a number, from 0.05 to 5"),
        ("hip_m = 0.45", "hip_m = 0.01", "hip_m = 0.01; expected a number, from 0.05 to 5"),
        ("[0.16, 0.08]", "[160, 80]", "sole_size_m = 160; expected a number, from 0.01 to 1"),
        ("[0.16, 0.08]", "[1e-6, 1e-6]", "sole_size_m = 1e-06; expected a number, from 0.01 to 1"),
        ("sole_m = [0.02, 0.0, -0.05]", "sole_m = [20, 0, -50]", "sole_m = 20; expected a number"),
        ("[0.16, 0.08]", "[0.9, 0.08]", "sole_size_m = 0.9; expected at most 0.45, hip_m"),
        (
            "[0.16, 0.08]",
            "[0.16, 0.3]",
            "narrowest_m = 0.12; expected at least 0.3, the width of a",
        ),
        ("narrowest_m = 0.12", "narrowest_m = 0.3", "stance_m = 0.16; expected at least 0.3, narr"),
        ("radius_m = 0.33", "radius_m = 0.05", "radius_m = 0.05; expected at least 0.2, half of"),
        ("passage_m = 0.6", "passage_m = 0.2", "passage_m = 0.2; expected at least 0.4, width_m"),
        ("lift_m = 0.03", "lift_m = 3", "lift_m = 3.0; expected at most 0.45, hip_m"),
        ("eye_m = 0.95", "eye_m = 4.5", "eye_m = 4.5; expected at most 1, height_m"),
        ('["r_hip_yaw"', '["l_hip_yaw"', "right = 'l_hip_yaw'; expected joints that are not those"),
        ('"l_hip_roll", ', "", "expected a list of 6 different names"),
        ("tilt_deg = [15, 65]", "tilt_deg = [65, 15]", "tilt_deg=(65.0, 15.0) must be (highest,"),
        ("cruise_mps = 0.12", "cruise_mps = 0.5", "cruise_mps=0.5 is above max_speed_mps=0.15"),
        ('frame = "head"', 'frame = "head"\naxis = "y"', "axis = 'y'; expected one of x, z, body"),
        ("[gaze]", "[gauze]", "key 'gauze' is unknown; did you mean 'gaze'?"),
        (TOF, "", "no table of a camera that measures depth; expected [tof], [depth] or [stereo]"),
        ("width = 106", "width = 10.5", "width = 10.5; expected a whole number"),
        ("down_deg = 58\n", "", "down_deg = None; expected a finite number"),
        ('title = "Little"', "title = 3", "title = 3; expected a text in quotes"),
        ("l_elbow = -10", 'l_elbow = "up"', "l_elbow = 'up'; expected a finite number"),
        ("turn_deg = 90", "turn_deg = [", "is not valid TOML"),
    ],
)
def test_a_mistake_in_a_description_is_named(tmp_path, old, new, message):
    path = changed(tmp_path, old, new)
    with pytest.raises(InputError, match=re.escape(message)) as caught:
        catalogue.load(str(path))
    assert str(path) in str(caught.value)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("\nturn_deg = 14", "\nturn_deg = 0.244", "turn_deg = 0.244; expected a number, from 2"),
        ("pan_deg = 80", "pan_deg = 1.396", "pan_deg = 1.396; expected a number, from 4 to 180"),
        ("[15, 65]", "[0.262, 1.134]", "tilt_deg = [0.262, 1.134]; expected a range of at least 4"),
        ("across_deg = 87", "across_deg = 1.518", "across_deg = 1.518; expected a number, from 4"),
        ("down_deg = 58", "down_deg = 1.012", "down_deg = 1.012; expected a number, from 4 to 169"),
        ("= -10", "= -0.1745", "expected deg; these may be rad, since none is beyond 3.15"),
        ("speed_radps = 2.0", "speed_radps = 115", "speed_radps = 115; expected a number, from"),
        ("[0.0, 0.015, 0.0]", "[0.0, 1.5, 0.0]", "at_m = 1.5; expected a number, from -0.5 to 0.5"),
        ("[camera]", "[camera]\nat_m = [0, 0, 0.9]", "at_m = 0.9; expected a number, from -0.5 to"),
    ],
)
def test_radians_for_degrees_and_centimetres_for_metres_are_refused(tmp_path, old, new, message):
    path = changed(tmp_path, old, new, -1)
    with pytest.raises(InputError, match=re.escape(message)):
        catalogue.load(str(path))


def test_some_joints_may_be_frozen_near_zero(tmp_path):
    robot = catalogue.load(str(changed(tmp_path, "= -10", "= -0.2")))
    assert robot.posture[0][1] == pytest.approx(-0.0035, abs=1e-5)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            r"\[dynamic\].*(?=\[odometry\])",
            "",
            "no table [dynamic] beside [odometry]; expected contact",
        ),
        (r"\[odometry\].*", "", "no table [odometry] beside [dynamic]; expected slip_m"),
        (
            r"(?<=slip_sigma_m = )",
            "-",
            "slip_sigma_m = -0.0008; expected a number, from 0 to 0.165",
        ),
        (
            r"(?<=step_x_sigma_m = )\S+",
            "2.8",
            "step_x_sigma_m = 2.8; expected a number, from 0 to 0.165",
        ),
        (
            r"(?<=slip_m = )-0.0021",
            "-2.1",
            "slip_m = -2.1; expected a number, from -0.165 to 0.165",
        ),
        (r"hold_m = \S+", "hold_m = 8", "hold_m = 8; expected a number, from 0 to 0.2"),
        (r"\[-0.05, 0.12\]", "[0.2, 0.12]", "expected the smaller number first"),
        (r"slew_m", "slow_m", "[dynamic] key 'slow_m' is unknown; did you mean 'slew_m'?"),
    ],
)
def test_a_mistake_in_how_a_robot_walks_dynamically_is_named(tmp_path, old, new, message):
    text = (Path(catalogue.__file__).parent / "g1.toml").read_text()
    assert re.search(old, text, re.DOTALL)
    path = tmp_path / "mine.toml"
    path.write_text(re.sub(old, new, text, count=1, flags=re.DOTALL))
    with pytest.raises(InputError, match=re.escape(message)):
        catalogue.load(str(path))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"little.urdf"', '"other.urdf"', "urdf = 'other.urdf': no such file"),
        ('"l_knee"', '"l_knees"', "no joint 'l_knees'"),
        ('frame = "head"', 'frame = "hat"', "no link 'hat'"),
        ('feet = ["l_foot", "r_foot"]', 'feet = ["r_foot", "l_foot"]', "'r_foot' is not carried"),
        (
            "tilt_deg = [15, 65]",
            "tilt_deg = [0, 65]",
            "tilt 0 deg is out of reach; the joints get to",
        ),
        (
            "turn_deg = 90",
            "turn_deg = 1.5708",
            "the left leg was expected on the left, as with 90 deg",
        ),
        (
            "turn_deg = 90",
            "turn_deg = -90",
            "the left leg was expected on the left, as with 90 deg",
        ),
        ("hip_m = 0.45", "hip_m = 0.8", "the legs of the URDF miss the floor by 0.3"),
        ("eye_m = 0.95", "eye_m = 0.6", "eye_m = 0.6; by the URDF the camera is 0.95 m above the"),
    ],
)
def test_a_description_that_its_urdf_contradicts_is_refused(tmp_path, old, new, message):
    robot = catalogue.load(str(changed(tmp_path, old, new)))
    with pytest.raises(InputError, match=re.escape(message)):
        jointed(robot)


def test_an_unknown_robot_a_missing_package_and_a_dynamic_body_say_what_to_do(monkeypatch):
    with pytest.raises(
        ConfigError, match=r"model='taloss' is unknown; did you mean 'talos'\? choose surefoot"
    ):
        catalogue.load("taloss")
    with pytest.raises(ConfigError, match=r"has no dynamic body: no table \[dynamic\] in .*little"):
        RobotConfig(model=str(LITTLE / "little.toml"), body="dynamic")

    def absent(name):
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr(metadata, "distribution", absent)
    assert installed.folder("example-robot-data") is None
    with pytest.raises(
        InputError, match=r"robot 'g1' needs the package example-robot-data.*pip install"
    ):
        catalogue.load("g1").urdf_path()
