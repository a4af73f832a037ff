"""The dynamic body of a described robot: servos in a physics engine follow the planned walk of its whole body.

Every tick the planned soles, moved by the control of landing and foot forces, become joint angles under the planned pelvis;
the ankles are corrected, and servos with joint offsets drive the links. Odometry comes from the encoders of the legs; the truth
from the engine. The floor is level; bumps are not known to the body.

Source: gains from walking trials with the models of `sim.robots`; the parts as of `sim.body.dynamic`.
"""

from __future__ import annotations

import copy
import math
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from perception.primitives.pose import Pose2, Pose3, times
from planning.commands import WalkCommand

from ...robots.description import Dynamic
from ...world import World
from ..dynamic.balance import AnkleFeedback, LandingControl, Touch
from ..dynamic.config import DynamicConfig
from ..dynamic.engines import begin
from ..dynamic.legs import tilt_rotation
from ..dynamic.odometry import Footprints, body_between_feet
from ..dynamic.physics import Stage
from ..dynamic.sensing import TrunkSensor
from ..dynamic.servo_body import ServoBody
from ..dynamic.urdf import floor_bumps
from ..dynamic.walker import FALLEN, TOP_M, still_parts
from ..gait import Gait, GaitConfig
from ..inertial import ImuConfig
from ..jointed import JointedHead
from ..pendulum import GRAVITY_MPS2
from .dynamics_filter import DynamicsFilter, Plan
from .foot_forces import FootForces
from .model import ankles, link_name, machine
from .tree import footprint, tree_of
from .waist import Waist

REPEATS = 2  # ours: of a step, that the dynamics filter looks ahead
LOWER_MPS, LOWER_M, FORGET_S = 0.06, 0.02, 1.0  # ours: of a foot that has not landed
LOAD_MEMORY = 0.6  # ours: share of the last forces kept in each tick
NARROWEST_M = 0.1  # ours: stance relative to which a capture point is off, at least


class HumanoidBody(ServoBody):
    """Walks by footsteps from a start pose; the members of `Body` are documented there."""

    def __init__(
        self,
        world: World,
        gait: GaitConfig,
        config: DynamicConfig,
        imu: ImuConfig,
        head: JointedHead,
        rng: np.random.Generator,
    ) -> None:
        """Place the robot and let it settle.

        Args:
            world: Its scene; all objects in it are solid.
            gait: Gait of the described robot.
            config: Bumps and slope of the floor.
            imu: Noise of means over 0.2 s.
            head: Moved along with every tick; it has the joint offsets and the resolution of the encoders.
            rng: Source of bumps and noise.
        """
        walk = head.robot.description.dynamic
        assert walk is not None
        self._walk: Dynamic = walk
        self._world, self._head, self._rng = world, head, rng
        tick_s = self._tick_s = gait.tick_s
        tree = self.tree = tree_of(head.robot.description)
        self.up = config.up
        self._gaze_joints = list(head.robot.gaze)
        self._angles = tree.standing(gait.stance_width_m, head.setpoints)
        self._com_m = tree.hip_m + float(tree.centre_of_mass(self._angles)[2])
        gait = replace(gait, com_height_m=self._com_m, zmp_inward_m=walk.inward_m)
        self._gait = Gait(gait, walk.start_s)
        self._omega = math.sqrt(GRAVITY_MPS2 / self._com_m)
        self._filter = DynamicsFilter(tree, self._omega, tick_s)
        bumps = floor_bumps(world.scene.extent, config.bump_m, rng) if config.bump_m > 0.0 else []
        soles = tree.soles(self._angles)
        ahead = Pose2(-sum(sole.translation[0] for sole in soles) / 2)
        stage = Stage(
            machine(tree, (walk.contact_x_m, walk.contact_y_m)),
            world.scene.start @ ahead,
            dict(zip(tree.names, self._angles.tolist(), strict=True)),
            tree.hip_m + config.bump_m,
            tick_s,
            config.up,
            bumps,
            still_parts(world.scene, TOP_M),
            [parts for _, parts, _ in world.scene.moving_bodies],
        )
        self.physics = begin(config.engine, stage)
        self._feet = [link_name(tree, int(chain[-1]) + 1) for chain in tree.chains]
        self._sensor = TrunkSensor(imu, config.balance, tick_s, rng)
        touch_n = walk.touch_share * tree.weight_n
        balance = replace(config.balance, wait_s=walk.wait_s)
        touch = Touch(touch_n, touch_n, walk.hold_m, LOWER_MPS, LOWER_M, FORGET_S)
        self._landing = LandingControl(balance, tick_s, 1.0, touch)
        self._forces = FootForces(walk.shift_mps, walk.shift_forget_s, tree.weight_n, tick_s)
        self._ankle_joints = ankles(tree)
        self._ankles = AnkleFeedback(tick_s, walk.ankle_gain, walk.ankle_rate_s)
        self._gaze = Waist(self._angles[self._gaze_joints], tick_s)
        self._encoders = head.read(self._angles)
        self._loads = np.zeros(2)
        self._last = self._angles.copy()
        self._forward_m = 0.0
        self._walking = False
        self._settle()

    @property
    def shift_ticks_left(self) -> int:
        """Ticks by which the double support of a step out of standing is still longer than commanded."""
        return max(self._step.double_support_ticks - self._double_ticks - self._tick, 0)

    @property
    def encoders(self) -> Float[np.ndarray, "n"]:
        """Angles of all joints by their encoders, rad."""
        return self._encoders

    @property
    def joints(self) -> Float[np.ndarray, "n"]:
        """True angles of all joints, rad."""
        return self._found

    @property
    def true_pose(self) -> Pose2:
        left, right = (footprint(sole) for sole in self._true_soles())
        return body_between_feet(left, right, footprint(self.physics.pelvis()).yaw)

    @property
    def true_height_m(self) -> float:
        """The floor is level."""
        return 0.0

    @property
    def feet_body(self) -> tuple[tuple[Pose2, float], tuple[Pose2, float]]:
        inverse = self.true_pose.inverse()
        left, right = (
            (inverse @ footprint(sole), max(sole.translation[2], 0.0))
            for sole in self._true_soles()
        )
        return left, right

    def foot_heights(self) -> tuple[float, float]:
        left_m, right_m = (sole.translation[2] for sole in self.tree.soles(self._encoders))
        standing_m = left_m if self._odometry.standing > 0 else right_m
        return left_m - standing_m, right_m - standing_m

    def trunk_from_encoders(self) -> Pose3:
        """Pelvis in the body frame as the robot estimates it, lowered by its height while walking.

        The legs by their encoders stand on a level sole; the tilt by the inertial sensor is a rotation about it.
        """
        feet = self._footprints
        pelvis, sole = self._odometry.pelvis(feet), self._odometry.sole(feet)
        height_m = self.tree.soles(self._encoders)[0 if self._odometry.standing > 0 else 1]
        foot = np.array([sole.x, sole.y, self.tree.hip_m + height_m.translation[2]])
        level = self._sensor.attitude.level()
        place = pelvis.lifted().translation + np.array([sole.x, sole.y, 0.0])
        return Pose3.from_rotation(level, place - times(level, foot))

    def true_trunk(self) -> Pose3:
        pelvis = self.true_pose.inverse().lifted() @ self.physics.pelvis()
        return pelvis @ Pose3((0.0, 0.0, -self.tree.hip_m))

    @property
    def _footprints(self) -> Footprints:
        """Left and right sole by the encoders, below a level pelvis."""
        left, right = self.tree.soles(self._encoders)
        return footprint(left), footprint(right)

    def _true_soles(self) -> list[Pose3]:
        return [
            self.physics.link(name) @ Pose3.from_matrix(tool)
            for name, tool in zip(self._feet, self.tree.tools, strict=True)
        ]

    def _begin_step(self) -> None:
        self._walking = self._tick > 0 and self._step.stepping
        wanted, self._command = self._command or WalkCommand(), None
        slew_m, before_m = self._walk.slew_m, self._forward_m
        ahead_m = min(wanted.forward_m, self._walk.step_m)
        forward_m = before_m + min(max(ahead_m - before_m, -slew_m), slew_m)
        command = replace(wanted, forward_m=0.0 if wanted.stay else forward_m, rise_m=0.0)
        self._step = self._gait.step(command)
        self._double_ticks = round(command.double_support_s / self._tick_s)
        self._forward_m = forward_m if self._step.stepping else 0.0
        ahead = copy.copy(self._gait)
        repeats = [ahead.step(command) for _ in range(REPEATS)]
        steps = [self._step, *repeats]
        gaze = self._gaze.ahead(self._head, sum(step.ticks for step in steps))
        self._plan: Plan = self._filter.plan(steps, gaze, self._angles)
        self._angles = self._plan.angles[-1].copy()
        self._sensor.begin_step(self._plan.velocity, self._step.body[:, 2])
        self._forces.begin_step(self._step)
        self._tick = 0

    def _advance_tick(self) -> None:
        """Plan, balance, servos, physics, sensors."""
        step, tick, plan = self._step, self._tick, self._plan
        tilt, rate = self._sensor.attitude.tilt, self._sensor.rate[:2]
        pressed = np.array([self.physics.sole_force(name) for name in self._feet])
        loads = self._loads = LOAD_MEMORY * self._loads + (1.0 - LOAD_MEMORY) * pressed
        side = self._landing.side_to_check(step, tick)
        load_n = float(loads[0 if side > 0 else 1]) if side else 0.0
        self._landing.update(step, tick, load_n)
        wait = self._walking and self._landing.must_wait(step, tick, load_n)
        left, right = plan.left[tick].copy(), plan.right[tick].copy()
        c, s = math.cos(plan.pelvis[tick, 3]), math.sin(plan.pelvis[tick, 3])
        apart_m = max(c * (left[1] - right[1]) - s * (left[0] - right[0]), NARROWEST_M)
        falls_m = -self._com_m * (tilt[0] + rate[0] / self._omega)
        self._forces.update(step, tick, loads, float(falls_m) / apart_m)
        heights = self._landing.heights + self._forces.heights
        left[2] += heights[0]
        right[2] += heights[1]
        self._head.advance(self._tick_s)
        turned = self._gaze.advance(self._head.setpoints[self._gaze_joints])
        angles = plan.angles[tick].copy()
        angles[self._gaze_joints] = turned
        pelvis = self.tree.pelvis_over(plan.com[tick], plan.pelvis[tick, 3], angles)
        self.tree.reach(pelvis, left, right, angles)
        self._correct_ankles(angles, tilt, rate)
        self._tick += 0 if wait else 1
        self._ticks += 1
        self._drive(angles)
        self.physics.step()
        self._follow(tick)

    def _correct_ankles(
        self,
        angles: Float[np.ndarray, "n"],
        tilt: Float[np.ndarray, "2"],
        rate: Float[np.ndarray, "2"],
    ) -> None:
        change = np.zeros(12)
        self._ankles.correct(change, tilt, rate, self.swinging, self._step.stepping)
        for leg, joints in enumerate(self._ankle_joints):
            for (joint, sign), more in zip(joints, change[6 * leg + 4 : 6 * leg + 6], strict=True):
                angles[joint] += sign * more

    def _drive(self, wanted: Float[np.ndarray, "n"]) -> None:
        """Servo setpoints, with joint offsets."""
        rates = (wanted - self._last) / self._tick_s
        self._last = wanted
        self.physics.command_joints(self.tree.names, wanted + self._head.offsets, rates)

    def _follow(self, tick: int) -> None:
        """Update encoders, the stance foot, the inertial sensor and the fall detection."""
        self._found = self.physics.angles(self.tree.names)
        motors = self._found - self._head.offsets
        self._encoders = self._head.read(motors)
        self._head.set_motors(motors)
        self._shift_weight(tick)
        self._sensor.sense(tick, self.physics.imu_reading())
        if tilt_rotation(self._sensor.attitude.tilt)[2, 2] < FALLEN:
            self.fallen = True
