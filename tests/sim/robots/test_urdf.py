"""URDFs as kinematic trees: PyBullet's forward kinematics, and files that are no tree."""

import math
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

from perception.primitives.errors import InputError
from perception.primitives.kinematics import link_poses
from sim import bullet
from sim.robots import urdf

LITTLE = Path(__file__).resolve().parents[2] / "little_robot" / "little.urdf"
WITHIN_M = 1e-5
INERTIAL = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'


def bullet_frames(path, angles, tmp_path):
    """Pose of every link of a URDF in the frame of its root by PyBullet, at joint angles by name."""
    robot = ET.parse(path).getroot()
    for link in robot.findall("link"):
        for part in list(link):
            link.remove(part)
        link.append(ET.fromstring(INERTIAL))
    for other in [e for e in robot if e.tag not in ("link", "joint")]:
        robot.remove(other)
    ET.indent(robot)
    plain = tmp_path / f"{path.stem}.urdf"
    plain.write_text(ET.tostring(robot, "unicode"))
    library = bullet.library()
    client = library.connect(library.DIRECT)
    try:
        body = library.loadURDF(str(plain), useFixedBase=True, physicsClientId=client)
        found = {}
        for joint in range(library.getNumJoints(body, physicsClientId=client)):
            info = library.getJointInfo(body, joint, physicsClientId=client)
            if (name := info[1].decode()) in angles:
                library.resetJointState(body, joint, angles[name], physicsClientId=client)
            found[info[12].decode()] = joint
        poses = {}
        for name, joint in found.items():
            state = library.getLinkState(
                body, joint, computeForwardKinematics=True, physicsClientId=client
            )
            T = np.eye(4)
            T[:3, :3] = np.reshape(library.getMatrixFromQuaternion(state[5]), (3, 3))
            T[:3, 3] = state[4]
            poses[name] = T
        return poses
    finally:
        library.disconnect(client)


def check_against_bullet(path, model, posture, rng, tmp_path):
    tree = model.tree
    angles = np.array([rng.uniform(joint.least_rad, joint.most_rad) for joint in tree.joints])
    named = posture | {j.name: float(a) for j, a in zip(tree.joints, angles, strict=True)}
    truth = bullet_frames(path, named, tmp_path)
    ours = link_poses(tree, angles)
    for name, T in truth.items():
        place = model.place(name)
        mine = ours[place.link] @ place.T_link_frame
        np.testing.assert_allclose(mine[:3, 3], T[:3, 3], atol=WITHIN_M, err_msg=name)
        np.testing.assert_allclose(mine[:3, :3], T[:3, :3], atol=WITHIN_M, err_msg=name)
    assert len(truth) > 10


@pytest.mark.parametrize("seed", range(3))
def test_every_link_is_where_pybullet_has_it(seed, tmp_path):
    posture = {"l_elbow": -0.4, "r_shoulder": 0.9, "lift": 0.05}
    moving = ["waist_yaw", "waist_pitch", "l_knee", "l_hip_roll", "r_ankle_pitch", "r_hip_yaw"]
    model = urdf.read(LITTLE, moving, posture)
    assert len(model.tree.joints) == len(moving)
    check_against_bullet(LITTLE, model, posture, np.random.default_rng(seed), tmp_path)


def test_every_link_of_other_makers_is_where_pybullet_has_it(maker, tmp_path):
    path, posture = maker.description.urdf_path(), dict(maker.description.posture)
    model = urdf.read(path, maker.description.moving, posture)
    check_against_bullet(path, model, posture, np.random.default_rng(0), tmp_path)


JOINT = '<joint name="{0}" type="{1}"><parent link="{2}"/><child link="{3}"/>{4}</joint>'
LINKS = '<link name="a"/><link name="b"/>'


@pytest.mark.parametrize(
    ("content", "moving", "message"),
    [
        (LINKS, ["knee"], "no joint 'knee'"),
        (LINKS, [], "2 links are carried by no joint"),
        (LINKS + JOINT.format("j", "fixed", "a", "b", ""), ["j"], "joint 'j' is fixed; only"),
        (LINKS + JOINT.format("j", "ball", "a", "b", ""), [], "of type 'ball'; expected revolute"),
        (
            LINKS + JOINT.format("j", "revolute", "a", "b", '<axis xyz="0 0 0"/>'),
            ["j"],
            "axis 0 0 0; expected a direction",
        ),
        (
            LINKS + JOINT.format("j", "revolute", "a", "b", '<limit lower="1" upper="1"/>'),
            ["j"],
            "expected lower < upper",
        ),
        (
            LINKS + JOINT.format("j", "fixed", "a", "b", "") + JOINT.format("k", "fixed", "b", "a", ""),
            [],
            "0 links are carried by no joint",
        ),
        (LINKS + LINKS, [], "4 links, 0 joints; expected at most 1000, each with its own name"),
        (LINKS + '<joint name="j" type="fixed"/>', [], "an element lacks link"),
        (
            LINKS + JOINT.format("j", "revolute", "a", "b", '<origin xyz="0 0 nan"/>'),
            ["j"],
            "expected 3 numbers",
        ),
    ],
)  # fmt: skip
def test_a_file_that_is_no_tree_is_refused(content, moving, message, tmp_path):
    path = tmp_path / "bad.urdf"
    path.write_text(f"<robot>{content}</robot>")
    with pytest.raises(InputError, match=message) as caught:
        urdf.read(path, moving, {})
    assert str(path) in str(caught.value)


def test_a_joint_without_an_end_turns_all_the_way(little):
    yaw = little.tree.joints[little.tree.index("waist_yaw")]
    assert (yaw.least_rad, yaw.most_rad) == (-math.pi, math.pi)


@pytest.mark.parametrize(
    ("kind", "limit"),
    [
        ("revolute", '<limit effort="1" velocity="1"/>'),  # without bounds, both are 0
        ("prismatic", '<limit lower="0" upper="0" effort="1" velocity="1"/>'),
        ("floating", ""),
        ("planar", '<axis xyz="0 0 1"/>'),
    ],
)
def test_a_joint_that_the_model_freezes_may_be_of_any_kind(kind, limit, tmp_path):
    path = tmp_path / "robot.urdf"
    place = '<origin xyz="0 0 1" rpy="0 0 0"/>'
    joints = JOINT.format("held", kind, "a", "b", place + limit)
    joints += JOINT.format("turns", "revolute", "b", "c", '<limit lower="-1" upper="1"/>')
    path.write_text(f'<robot name="r">{LINKS}<link name="c"/>{joints}</robot>')
    model = urdf.read(path, ["turns"], {})
    assert [joint.name for joint in model.tree.joints] == ["turns"]
    np.testing.assert_allclose(model.place("b").T_link_frame[:3, 3], [0.0, 0.0, 1.0])
