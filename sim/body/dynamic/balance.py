"""Balance control: attitude estimate, ankle feedback, and adaptation of the landing to the floor.

The tilt that the inertial sensor estimates is fed back to the ankles of the standing feet. A sole that touches the
floor before its time is held at that height; one that has not touched it when the weight arrives is lowered further.
Both corrections decay while the foot stands.

Source: walking trials. Ankle gains of 0.3 and 0.05 drift by metres, the opposite sign falls at once, permanent
feedback to the hips falls, soft soles do not help. A push of 1 N s moves the capture point by 5 cm, half a sole. Of
100 such pushes (any instant, any direction) 9 end in a fall without recovery; half of these go outward over the
stance foot, where no step is possible, and 6 remain when the weight is planned 6 mm further inward. `capture` prevents
the falls towards the foot in the air (9 of 41 before, 1 after), and 4 to 6 falls remain; 3 with `hip_strategy`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from perception.primitives.errors import ConfigError

from ...ranges import check_ranges
from ..gait import Step
from ._legs_kernels import update_vertical
from .legs import tilt_rotation

TILT_GAIN = 0.15  # ours: of 24 walks over bumps of 5 mm 1 fell; 3 with the trials' 0.10 and 0.02
GYRO_GAIN_S = 0.025  # ours
STANDING_SHARE = 1.0 / 3.0  # ours: share of the gyro gain for a standing body
TILT_MEMORY = 0.5  # walking trials: share of the last tilt kept in each tick
BLEND_S = 0.03  # ours: time to fade the feedback of an ankle in or out; lag of the hips
DUE_SHARE = 0.55  # walking trials: share of the swing before which no landing is accepted
TOUCH_N = 2.0  # walking trials: sole force that counts as contact
HOLD_MOST_M = 0.008  # walking trials: greatest height of an early landing
FORGET_S = 1.0  # walking trials: decay of height corrections
LIGHT_N = 0.5  # walking trials: sole force below which the foot is lowered
LOWER_MPS = 0.03  # walking trials
LOWER_MOST_M = 0.010  # ours; with the trials' 0.006 4 of 20 walks over bumps of 4 mm fell
LAND_NOW_MPS = 0.3  # ours: speed of a foot that lands at once


@dataclass(frozen=True)
class BalanceConfig:
    """Parameters of the balance control that trials vary; lengths for a DARwIn-OP, scaled with the body.

    Args:
        attitude_s: Time constant with which the accelerometer corrects the gyro's vertical.
        wait_s: Longest wait for a sole that has not touched the floor.
        inward_m: Inward shift of the planned ZMP over the stance sole.
        deadband_m: Capture point error below which neither step nor trunk reacts.
        tipping_m: Lateral capture point error from which the swing foot lands at once.
        bend_most_rad: Limits of the trunk's bend at the hips, roll and pitch.
    """

    attitude_s: float = 2.0  # ours
    wait_s: float = 0.25  # ours
    inward_m: float = 0.006  # ours
    deadband_m: float = 0.020  # ours: without pushes 1 step in 20 exceeds 15 mm, 1 in 100 24 mm
    tipping_m: float = 0.045  # ours: with 0.030 more walks over bumps fell, with 0.020 pushed ones
    bend_most_rad: tuple[float, float] = (0.4, 0.8)  # ours: roll stretches a leg fully

    def __post_init__(self) -> None:
        if not self.attitude_s > 0.0:
            raise ConfigError(f"balance: attitude_s={self.attitude_s} must be positive")
        check_ranges(
            "balance",
            self,
            wait_s=(0.0, 10.0),
            inward_m=(-0.1, 0.1),
            deadband_m=(0.0, 1.0),
            tipping_m=(0.0, 1.0),
            bend_most_rad=(0.0, 1.0),
        )


class Attitude:
    """Vertical in trunk axes from gyro and accelerometer.

    The planned acceleration of the walk is first subtracted from the accelerometer; otherwise the lateral motion of a
    step would tilt the estimate by degrees.

    Source: Mahony et al. 2008 (complementary filter that estimates the gyro's bias).
    """

    def __init__(self, config: BalanceConfig, tick_s: float) -> None:
        self.up = np.array([0.0, 0.0, 1.0])
        self._bias = np.zeros(3)
        self._tick_s = tick_s
        self._share = tick_s / config.attitude_s
        self._learn = tick_s / (4.0 * config.attitude_s**2)  # critically damped

    def update(
        self,
        rate: Float[np.ndarray, "3"],
        force: Float[np.ndarray, "3"],
        planned: Float[np.ndarray, "2"],
    ) -> None:
        """Update by one tick of the sensor.

        Args:
            rate, force: Trunk axes, rad/s and m/s^2.
            planned: Planned acceleration of the centre of mass along and across the body, m/s^2.
        """
        rest = force.copy()
        rest[:2] -= planned
        update_vertical(self.up, self._bias, rate, rest, self._tick_s, self._share, self._learn)

    @property
    def tilt(self) -> Float[np.ndarray, "2"]:
        """Roll and pitch, rad."""
        x, y, z = (float(v) for v in self.up)
        return np.array([math.atan2(y, z), math.atan2(-x, math.hypot(y, z))])

    def yaw_rate(self, rate: Float[np.ndarray, "3"]) -> float:
        """Rate of the heading, rad/s, for an angular velocity in trunk axes."""
        roll, pitch = self.tilt.tolist()
        return float((math.sin(roll) * rate[1] + math.cos(roll) * rate[2]) / math.cos(pitch))

    def level(self) -> Float[np.ndarray, "3 3"]:
        """Rotation from trunk axes to level axes of the same heading."""
        return tilt_rotation(self.tilt)


class AnkleFeedback:
    """Feedback of the tilt, and of its rate, to the ankles of the standing feet."""

    def __init__(
        self, tick_s: float, tilt_gain: float = TILT_GAIN, gyro_gain_s: float = GYRO_GAIN_S
    ) -> None:
        self._tilt_gain, self._gyro_gain_s = tilt_gain, gyro_gain_s
        self._change = tick_s / BLEND_S
        self._tilt = np.zeros(2)
        self._weight = np.ones(2)  # of the feedback, left and right
        self._damping = STANDING_SHARE  # share of the gyro gain

    def correct(
        self,
        angles: Float[np.ndarray, "12"],
        tilt: Float[np.ndarray, "2"],
        rate: Float[np.ndarray, "2"],
        swinging: int,
        walking: bool,
    ) -> None:
        """Add the feedback to ankle pitch and roll, in place.

        The gyro acts with its full gain only while the body walks: a standing body would shake with the gyro's noise.

        Args:
            angles: Leg joints, changed in place.
            tilt, rate: Roll and pitch of the body, without the bend of the hips, rad and rad/s.
            swinging: Foot in the air, +1 left, -1 right, 0 none.
            walking: Whether a foot swings in this step.
        """
        full = 1.0 if walking else STANDING_SHARE
        self._damping += min(max(full - self._damping, -self._change), self._change)
        self._tilt = TILT_MEMORY * self._tilt + (1.0 - TILT_MEMORY) * tilt
        damping = self._damping * self._gyro_gain_s
        roll, pitch = self._tilt_gain * self._tilt + damping * rate
        for k, side in enumerate((1, -1)):
            target = 0.0 if swinging == side else 1.0
            self._weight[k] += min(max(target - self._weight[k], -self._change), self._change)
            angles[6 * k + 4] += self._weight[k] * pitch
            angles[6 * k + 5] += self._weight[k] * roll


@dataclass(frozen=True)
class Touch:
    """When a sole has landed, and how far it may leave its planned height.

    Args:
        touch_n: Force on a sole that counts as contact.
        light_n: Force below which a foot that should stand is lowered.
        hold_m: Greatest height of an early landing.
        lower_mps, lower_m: Speed and limit with which a foot is lowered.
        forget_s: Decay of the corrections.
    """

    touch_n: float = TOUCH_N
    light_n: float = LIGHT_N
    hold_m: float = HOLD_MOST_M
    lower_mps: float = LOWER_MPS
    lower_m: float = LOWER_MOST_M
    forget_s: float = FORGET_S


SMALL_TOUCH = Touch()


class LandingControl:
    """Height corrections of both soles against the plan, m."""

    def __init__(
        self,
        config: BalanceConfig,
        tick_s: float,
        scale: float = 1.0,
        touch: Touch = SMALL_TOUCH,
    ) -> None:
        self._config = config
        self._tick_s = tick_s
        self._fade = math.exp(-tick_s / touch.forget_s)
        self._scale = scale
        self._touch = touch
        self.heights = np.zeros(2)  # left, right
        self._held: list[float | None] = [None, None]
        self._waited = 0
        self._landing_now = False

    def side_to_check(self, step: Step, tick: int) -> int:
        """Foot whose sole force this tick needs, +1 left, -1 right, 0 none."""
        if not step.stepping:
            return 0
        if tick < step.double_support_ticks:
            return -step.swing
        share = (tick - step.double_support_ticks) / (step.ticks - step.double_support_ticks)
        return step.swing if self._landing_now or share > DUE_SHARE else 0

    def land_now(self) -> None:
        """Lower the swing foot at once, wherever it is."""
        self._landing_now = True

    def landed_early(self, step: Step) -> bool:
        """Whether the swing foot was lowered at once and has touched the floor."""
        return self._landing_now and self._held[0 if step.swing > 0 else 1] is not None

    def update(self, step: Step, tick: int, load_n: float) -> None:
        """Update the corrections by one tick.

        Args:
            step: Current step.
            tick: Tick within it.
            load_n: Force on the checked sole.
        """
        if tick < step.double_support_ticks:
            self._landing_now = False
        checked = self.side_to_check(step, tick)
        for k, side in enumerate((1, -1)):
            swinging = step.stepping and tick >= step.double_support_ticks and side == step.swing
            if not swinging:
                self.heights[k] *= self._fade
                self._held[k] = None
            if side != checked:
                continue
            if swinging:
                self._hold(k, float(step.lift[tick]), load_n)
            elif load_n < self._touch.light_n:
                lower = self.heights[k] - self._touch.lower_mps * self._tick_s * self._scale
                self.heights[k] = max(lower, -self._touch.lower_m * self._scale)

    def must_wait(self, step: Step, tick: int, load_n: float) -> bool:
        """Whether the plan pauses at the start of a double support because the new foot bears no weight yet.

        A body that leans outward over its stance foot swings back by itself unless its weight is meanwhile shifted
        onto a foot in the air.
        """
        late = step.stepping and tick == 0 and load_n < self._touch.touch_n
        if late and self._waited < self._config.wait_s / self._tick_s:
            self._waited += 1
            return True
        if tick > 0:
            self._waited = 0
        return False

    def _hold(self, k: int, lift: float, load_n: float) -> None:
        """After contact keep the sole at the height of contact."""
        held = self._held[k]
        if held is None:
            if load_n > self._touch.touch_n:
                self._held[k] = lift + self.heights[k]
            elif self._landing_now:
                lower = self.heights[k] - LAND_NOW_MPS * self._tick_s * self._scale
                self.heights[k] = max(lower, -lift - self._touch.lower_m * self._scale)
        elif self._landing_now:
            self.heights[k] = held - lift
        else:
            most = self._touch.hold_m * self._scale
            self.heights[k] = min(max(held - lift, self.heights[k]), most)
