"""A described robot with its URDF: where legs, feet, cameras and hulls are for given joint angles.

The trunk frame is the body frame moved with the pelvis: on the floor below the root of the URDF, x ahead. Its height
above the floor follows from the height of the hips while walking.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from jaxtyping import Float
from scipy.spatial import ConvexHull

from perception.primitives.errors import InputError
from perception.primitives.kinematics import KinematicTree, link_poses
from perception.primitives.own_body import OwnBody, OwnPart
from perception.primitives.pose import CAMERA_IN_BODY_AXES, Pose2, Pose3, wrap_angle

from . import urdf
from .description import Description
from .hulls import Hull, hull_of, points_of
from .leg_kinematics import bent, solved

HOUSING_M = 0.08  # ours: parts nearer to a camera than this, on its link, are its housing
AIMED_RAD = math.radians(
    3.0
)  # ours: by which the stated range of the gaze may exceed that of the joints
MISS_M = 0.005  # ours: of soles that the legs can place
EYE_SHARE = 0.2  # ours: of the height, by which the stated height of the eyes may be wrong
AIM_STEPS = 8  # ours: of Newton's method

Feet = tuple[tuple[Pose2, float], tuple[Pose2, float]]
"""Left and right sole in the body frame, each with its height above that frame, m."""


@dataclass(frozen=True, eq=False)
class JointedRobot:
    """A robot that can be posed.

    Args:
        description: What it was made from.
        tree: The moving joints: left leg, right leg, pan and tilt, in any order.
        hulls: All convex parts.
        legs: Joints of the left and of the right leg, from the hip down.
        feet: Frames of the feet in the last links of the legs, homogeneous.
        level: Rotations of these frames in the trunk frame with all joints at zero.
        T_trunk_base: Root of the URDF in the trunk frame.
        gaze: The joints that pan and tilt.
        eye_link: Link that carries the cameras.
        T_link_eye: Their frame on it: x ahead along the optical axis, z up, homogeneous.
    """

    description: Description
    tree: KinematicTree
    hulls: tuple[Hull, ...]
    legs: tuple[tuple[int, ...], tuple[int, ...]]
    feet: tuple[Float[np.ndarray, "4 4"], Float[np.ndarray, "4 4"]]
    level: tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3 3"]]
    T_trunk_base: Pose3
    gaze: tuple[int, int]
    eye_link: int
    T_link_eye: Float[np.ndarray, "4 4"]

    def eye(self, angles: Float[np.ndarray, "n"]) -> Pose3:
        """The frame of the cameras in the trunk frame."""
        pose = link_poses(self.tree, angles)[self.eye_link] @ self.T_link_eye
        return self.T_trunk_base @ Pose3.from_matrix(pose)

    def camera(self, angles: Float[np.ndarray, "n"], mount: tuple[float, float, float]) -> Pose3:
        """A camera in the trunk frame; the mount is its place in the frame of the cameras, m."""
        return self.eye(angles) @ Pose3.from_rotation(CAMERA_IN_BODY_AXES, np.array(mount))

    @property
    def bent(self) -> Float[np.ndarray, "n"]:
        """Angles to begin with: bent knees, the gaze at zero, rad."""
        angles = np.zeros(len(self.tree.joints))
        for leg in self.legs:
            angles[list(leg)] = bent(self.tree, leg)
        return angles

    def standing(
        self, angles: Float[np.ndarray, "n"], T_body_trunk: Pose3, feet: Feet
    ) -> Float[np.ndarray, "n"]:
        """Angles with which both soles are at their places, from angles nearby.

        Args:
            angles: To begin with; those of the gaze stay.
            T_body_trunk: Of the pelvis.
            feet: Places of the soles.
        """
        T_base_body = (T_body_trunk @ self.T_trunk_base).inverse()
        x, y, z = self.description.legs.sole_m
        for leg, foot, level, side, (place, lift_m) in zip(
            self.legs, self.feet, self.level, (1.0, -1.0), feet, strict=True
        ):
            sole = Pose2(place.x, place.y, place.yaw).lifted()
            ankle = sole.apply(np.array([-x, -side * y, -z])) + np.array([0.0, 0.0, lift_m])
            wanted = T_base_body @ Pose3.from_rotation(sole.rotation @ level, ankle)
            angles, _ = solved(self.tree, angles, leg, foot, wanted)
        return angles

    def aimed(
        self, angles: Float[np.ndarray, "n"], pan_rad: float, tilt_rad: float
    ) -> tuple[float, float]:
        """Angles of the gaze joints that turn the optical axis there, as far as they can; left and down positive."""
        found = np.array(angles, dtype=np.float64)
        joints = [self.tree.joints[j] for j in self.gaze]
        least, most = [j.least_rad for j in joints], [j.most_rad for j in joints]
        chosen = list(self.gaze)
        for _ in range(AIM_STEPS):
            here = self.direction(found)
            miss = np.array([wrap_angle(pan_rad - here[0]), tilt_rad - here[1]])
            slope = np.empty((2, 2))
            for column, joint in enumerate(self.gaze):
                beside = found.copy()
                beside[joint] += 1e-6
                pan, tilt = self.direction(beside)
                slope[:, column] = wrap_angle(pan - here[0]) / 1e-6, (tilt - here[1]) / 1e-6
            step = np.linalg.lstsq(slope, miss, rcond=1e-6)[0]
            found[chosen] = np.clip(found[chosen] + np.clip(step, -0.5, 0.5), least, most)
        return float(found[self.gaze[0]]), float(found[self.gaze[1]])

    def direction(self, angles: Float[np.ndarray, "n"]) -> tuple[float, float]:
        """Pan and tilt of the optical axis against the trunk, rad, left and down positive."""
        x, y, z = (float(v) for v in self.eye(angles).rotation[:, 0])
        return math.atan2(y, x), -math.asin(min(max(z, -1.0), 1.0))

    def own_body(
        self,
        joint_sigma_rad: float,
        trunk_sigma_rad: float,
        mounts: Sequence[tuple[float, float, float]],
    ) -> OwnBody:
        """The parts that the cameras may see; their housing is not among them.

        Args:
            joint_sigma_rad: Standard deviation of a joint's angle against its encoder.
            trunk_sigma_rad: Of what no encoder measures between camera and legs.
            mounts: Places of the cameras, see `camera`.
        """
        parts = []
        for hull in self.hulls:
            count = self.tree.joints_between(self.eye_link, hull.link)
            if count == 0 and any(self._houses(hull, mount) for mount in mounts):
                continue
            sigma = (
                math.hypot(math.sqrt(count) * joint_sigma_rad, trunk_sigma_rad) if count else 0.0
            )
            parts.append(OwnPart(hull.name, hull.link, hull.corners, hull.cut_m, sigma))
        return OwnBody(self.tree, tuple(parts))

    def _houses(self, hull: Hull, mount: tuple[float, float, float]) -> bool:
        eye = self.T_link_eye[:3, :3] @ np.array(mount) + self.T_link_eye[:3, 3]
        planes = ConvexHull(hull.corners).equations
        return bool((planes[:, :3] @ eye + planes[:, 3]).max() < HOUSING_M)


@cache
def jointed(description: Description) -> JointedRobot:
    """The robot of a description, read from its URDF; cached.

    Raises:
        InputError: The URDF is missing or damaged, or does not fit the description.
    """
    legs, gaze = description.legs, description.gaze
    model = urdf.read(description.urdf_path(), description.moving, dict(description.posture))
    tree = model.tree
    zero = link_poses(tree, np.zeros(len(tree.joints)))
    turn = Pose2(0.0, 0.0, -math.radians(description.turn_deg)).lifted().rotation
    chains = tuple(tuple(tree.index(name) for name in leg) for leg in (legs.left, legs.right))
    feet, level = [], []
    for chain, name in zip(chains, legs.feet, strict=True):
        place = model.place(name)
        if place.link != chain[-1] + 1 or sorted(tree.path(place.link)) != sorted(chain):
            raise InputError(
                f"{description.file}: [legs] feet: {name!r} is not carried by its six joints alone; expected the hip's "
                "first joint on the root and the foot on the last joint"
            )
        feet.append(place.T_link_frame)
        level.append(turn @ (zero[place.link] @ place.T_link_frame)[:3, :3])
    height_m = description.model.hip_m - tree.joints[chains[0][0]].origin.translation[2]
    eye = model.place(gaze.frame)
    robot = JointedRobot(
        description,
        tree,
        _hulls(model),
        (chains[0], chains[1]),
        (feet[0], feet[1]),
        (level[0], level[1]),
        Pose3.from_rotation(turn, np.array([0.0, 0.0, height_m])),
        (tree.index(gaze.pan), tree.index(gaze.tilt)),
        eye.link,
        eye.T_link_frame @ _view(description, turn @ (zero[eye.link] @ eye.T_link_frame)[:3, :3]),
    )
    _check_gaze(robot)
    _check_stance(robot)
    return robot


def _view(description: Description, frame: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "4 4"]:
    """The frame of the cameras, x ahead, in the frame of the description, whose rotation in the trunk is given."""
    axes = {"x": np.eye(3), "z": CAMERA_IN_BODY_AXES.T, "body": frame.T}[description.gaze.axis]
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = axes, axes @ np.array(description.gaze.at_m)
    return T


def _hulls(model: urdf.Merged) -> tuple[Hull, ...]:
    """The hull of every geometry, on the links of the tree."""
    found: list[Hull] = []
    for name, shape in model.shapes:
        place = model.place(name)
        points = points_of(shape, model.path)
        T = place.T_link_frame
        hull = hull_of(f"{name} {len(found)}", place.link, points @ T[:3, :3].T + T[:3, 3])
        if hull is not None:
            found.append(hull)
    return tuple(found)


def _check_gaze(robot: JointedRobot) -> None:
    """Raise an InputError unless the joints reach the stated range of the gaze."""
    head = robot.description.model.head
    middle = sum(head.tilt_deg) / 2
    wanted = [(0.0, tilt) for tilt in head.tilt_deg]
    wanted += [(pan, middle) for pan in (head.pan_deg, -head.pan_deg)]
    for pan_deg, tilt_deg in wanted:
        pan, tilt = math.radians(pan_deg), math.radians(tilt_deg)
        angles = np.zeros(len(robot.tree.joints))
        angles[list(robot.gaze)] = robot.aimed(angles, pan, tilt)
        there = robot.direction(angles)
        if max(abs(wrap_angle(there[0] - pan)), abs(there[1] - tilt)) > AIMED_RAD:
            raise InputError(
                f"{robot.description.file}: [gaze] pan {pan_deg:g} deg, tilt {tilt_deg:g} deg is out of reach; the joints get to "
                f"{math.degrees(there[0]):.0f} and {math.degrees(there[1]):.0f} deg, state a smaller range"
            )


def _check_stance(robot: JointedRobot) -> None:
    """Raise an InputError unless the left leg is on the left, the soles reach the floor, and the eyes are where stated."""
    description, model = robot.description, robot.description.model
    zero = link_poses(robot.tree, np.zeros(len(robot.tree.joints)))
    left, right = (robot.T_trunk_base.apply(zero[leg[0] + 1][:3, 3]) for leg in robot.legs)
    x, y, _ = left - right
    if y < abs(x):
        turn = math.degrees(wrap_angle(math.radians(description.turn_deg) + math.atan2(-x, y)))
        raise InputError(
            f"{description.file}: turn_deg = {description.turn_deg:g}; the left leg was expected on the left, as with "
            f"{turn:.0f} deg, or [legs] name the wrong sides"
        )
    half = description.walk.stance_m / 2
    angles = robot.standing(
        robot.bent, Pose3(), ((Pose2(0.0, half), 0.0), (Pose2(0.0, -half), 0.0))
    )
    poses = link_poses(robot.tree, angles)
    for leg, foot, side in zip(robot.legs, robot.feet, (1.0, -1.0), strict=True):
        ankle = robot.T_trunk_base.apply((poses[leg[-1] + 1] @ foot)[:3, 3])
        ahead, outward, up = description.legs.sole_m
        miss = math.dist(ankle, (-ahead, side * (half - outward), -up))
        if miss > MISS_M:
            raise InputError(
                f"{description.file}: [gait] hip_m = {model.hip_m:g}, stance_m = {2 * half:g}: the legs of the URDF miss "
                f"the floor by {miss:.2g} m; expected lengths in m at which both soles stand, with bent knees"
            )
    eye_m = float(robot.eye(angles).position[2])
    if abs(eye_m - model.eye_m) > EYE_SHARE * model.height_m:
        raise InputError(
            f"{description.file}: [camera] eye_m = {model.eye_m:g}; by the URDF the camera is {eye_m:.2f} m above the floor"
        )
