"""The joints of a robot that is described by a URDF: gaze joints that move, legs that follow the feet.

The legs have no motion of their own: their angles are those with which the soles are where the gait puts them, by inverse
kinematics under the pelvis. The true angles belong to the true, swaying trunk; the encoders give those of the trunk by
the joints, with their offsets and resolution, as they do for the neck.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float

from perception.primitives.kinematics import link_poses
from perception.primitives.own_body import JointReading, OwnBody
from perception.primitives.pose import Pose3
from planning.commands import GazeCommand

from ..robots.jointed import JointedRobot
from ..shapes import Solid
from .body import Body, true_frame
from .head import HeadConfig

MATERIAL = "plaster/slate"  # ours: of every link


def solids_of(robot: JointedRobot, own: OwnBody) -> dict[int, tuple[Solid, ...]]:
    """What cameras see of a robot: by link of its tree the solids about the frame of the link."""
    seen = {part.name for part in own.parts}
    shown = [hull for hull in robot.hulls if hull.name in seen]
    return {
        link: tuple(
            Solid(hull.corners, hull.triangles, MATERIAL) for hull in shown if hull.link == link
        )
        for link in sorted({hull.link for hull in shown})
    }


class JointedHead:
    """The joints that turn the cameras: those of a neck, or of a waist that turns arms and cameras together.

    It takes the place of `Head`; the frame of the pelvis is the trunk frame of `JointedRobot`.
    """

    def __init__(self, robot: JointedRobot, config: HeadConfig, rng: np.random.Generator) -> None:
        self.robot, self.config = robot, config
        count = len(robot.tree.joints)
        self.offsets = math.radians(config.offset_deg) * rng.standard_normal(count)
        self._angles = np.zeros(count)
        self._aim = self._reached(*robot.direction(self._angles))
        self._angles[list(robot.gaze)] = self._aim
        self._lag = np.zeros(count)

    def look(self, gaze: GazeCommand) -> None:
        """Set the gaze, clipped to the range of the robot and of its joints."""
        self._aim = self._reached(gaze.pan_rad, gaze.tilt_rad)

    @property
    def setpoints(self) -> Float[np.ndarray, "n"]:
        """Angles of the gaze joints commanded to their motors now, rad; zero for the legs."""
        return self._angles

    def ahead(self, seconds: float, count: int) -> Float[np.ndarray, "k 2"]:
        """Setpoints of the gaze joints in that many intervals from now, unless the gaze is changed."""
        start, aim = self._angles[list(self.robot.gaze)], np.array(self._aim)
        step = self.config.speed_radps * seconds * np.arange(1, count + 1)[:, None]
        return start + np.clip(aim - start, -step, step)

    def set_motors(self, angles: Float[np.ndarray, "n"]) -> None:
        """Set where the motors of the gaze are; called by a body with dynamics."""
        chosen = list(self.robot.gaze)
        self._lag[chosen] = angles[chosen] - self._angles[chosen]

    def advance(self, seconds: float) -> None:
        """Move both joints towards the gaze, each within the speed limit."""
        chosen, step = list(self.robot.gaze), self.config.speed_radps * seconds
        self._angles[chosen] += np.clip(np.array(self._aim) - self._angles[chosen], -step, step)

    def camera_from_encoders(self, mount: tuple[float, float, float]) -> Pose3:
        """Camera in the frame of the pelvis as the encoders give it; the mount is its position in the frame of the cameras, m."""
        return self.robot.camera(self.read(self.commanded_angles), mount)

    def true_camera(self, mount: tuple[float, float, float]) -> Pose3:
        """True camera in the frame of a pelvis without sway."""
        return self.robot.camera(self.true_angles, mount)

    @property
    def true_angles(self) -> Float[np.ndarray, "n"]:
        """True angles of the gaze joints, rad; zero for the legs."""
        chosen, angles = list(self.robot.gaze), self._angles + self._lag
        angles[chosen] += self.offsets[chosen]
        return angles

    @property
    def commanded_angles(self) -> Float[np.ndarray, "n"]:
        """Angles of the gaze joints by their motors, rad; zero for the legs."""
        return self._angles + self._lag

    def read(self, angles: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
        """Angles as encoders of this resolution give them, rad."""
        count = math.radians(self.config.encoder_deg)
        return np.round(angles / count) * count if count > 0.0 else angles

    def _reached(self, pan_rad: float, tilt_rad: float) -> tuple[float, float]:
        reach = math.radians(self.config.pan_deg)
        high, low = (math.radians(v) for v in self.config.tilt_deg)
        pan, tilt = min(max(pan_rad, -reach), reach), min(max(tilt_rad, high), low)
        return self.robot.aimed(self._zero, pan, tilt)

    @property
    def _zero(self) -> Float[np.ndarray, "n"]:
        return np.zeros(len(self.robot.tree.joints))


class JointedLegs:
    """Angles of all joints, frame by frame: the legs below a walking body, and the gaze above it."""

    def __init__(self, head: JointedHead, body: Body) -> None:
        self._head, self._body = head, body
        self._true = self._measured = head.robot.bent

    def reading(self) -> JointReading:
        """All angles by the encoders at this instant."""
        robot, head = self._head.robot, self._head
        trunk = self._body.trunk_from_encoders()
        angles = self._with_gaze(self._measured, head.commanded_angles)
        self._measured = robot.standing(angles, trunk, self._body.feet_body)
        legs = [j for leg in robot.legs for j in leg]
        shown = self._measured.copy()
        shown[legs] += head.offsets[legs]
        return JointReading(trunk @ robot.T_trunk_base, tuple(head.read(shown).tolist()))

    def true_links(self) -> list[Pose3]:
        """True pose of every link in the world at this instant, base first."""
        robot, trunk = self._head.robot, self._body.true_trunk()
        angles = self._with_gaze(self._true, self._head.true_angles)
        self._true = robot.standing(angles, trunk, self._body.feet_body)
        base = true_frame(self._body) @ trunk @ robot.T_trunk_base
        return [base @ Pose3.from_matrix(T) for T in link_poses(robot.tree, self._true)]

    def _with_gaze(
        self, angles: Float[np.ndarray, "n"], gaze: Float[np.ndarray, "n"]
    ) -> Float[np.ndarray, "n"]:
        chosen, found = list(self._head.robot.gaze), angles.copy()
        found[chosen] = gaze[chosen]
        return found
