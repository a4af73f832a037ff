"""Standing up to reality: ankles against tilt, feet that come down early or late.

The inertial sensor's tilt is fed to the ankles of the feet that stand. A sole that meets the floor before
it was due is held where it is; one that has not met it when the weight comes is let down further. Both
memories fade while the foot stands.

Source: walking trials: gains 0.3 and 0.05 drift for metres, the opposite sign falls at once, feedback to
the hips at all times falls, soft soles do not help. A push of 1 N s throws the capture point 5 cm off, which
is half a sole. Of 100 such pushes, at any instant and from anywhere, 9 end in a fall where none is answered.
Half of these lead outward over the standing foot, where no step can come between: with the weight planned
6 mm further inward there are 6. What `capture` does takes the falls towards the foot in the air (9 of 41
there, then 1), and 4 to 6 are left all the same; 3 with what the hips do (`hip_strategy`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from perception.primitives.errors import ConfigError

from ...ranges import check_ranges
from ..gait import Step
from ._legs_kernels import attend
from .legs import tilted


@dataclass(frozen=True)
class BalanceConfig:
    """Gains of the balance; all lengths for a DARwIn-OP, grown with the body by its owner."""

    tilt_gain: float = 0.15  # ours; walking trials 0.10 and 0.02 ...
    gyro_gain_s: float = 0.025  # ... over bumps of 5 mm 3 of 24 walks fell with these, with ours 1
    standing_share: float = 1.0 / 3.0  # ours: of the gyro's gain, for a body that stands
    tilt_memory: float = 0.5  # walking trials: share of the last tilt kept each tick
    blend_s: float = 0.03  # ours: an ankle takes part, and ceases to, over so long; hips follow so
    attitude_s: float = 2.0  # ours: the accelerometer corrects the gyro's vertical this slowly
    due_share: float = 0.55  # walking trials: of the swing, before which no landing is believed
    touch_n: float = 2.0  # walking trials
    hold_most_m: float = 0.008  # walking trials
    forget_s: float = 1.0  # walking trials
    light_n: float = 0.5  # walking trials
    lower_mps: float = 0.03  # walking trials
    lower_most_m: float = (
        0.010  # ours; walking trials 0.006: with it 4 of 20 walks over bumps of 4 mm fell
    )
    wait_s: float = (
        0.25  # ours: longest wait for a sole that has not met the floor; then on regardless
    )
    inward_m: float = 0.006  # ours: the weight is planned so much further inside the standing sole
    astray_m: float = 0.020  # ours: unpushed, 1 step in 20 is 15 mm astray, 1 in 100 is 24 mm
    answer: float = 2.0  # ours: footsteps go so many times further; it grows until they are made
    tipping_m: float = 0.045  # ours: with 0.030 more walks fell over bumps, with 0.020 when pushed
    put_down_mps: float = 0.3  # ours
    bend_rad_per_m: float = 12.0  # ours: of the trunk, beyond `astray_m`; 10 and 14 do as well
    bend_most_rad: tuple[float, float] = (0.4, 0.8)  # ours: roll, until a leg is stretched; pitch
    bend_radps: float = 6.0  # ours: what servos of this size can do
    bend_radps2: float = (
        100.0  # ours: 200 does as well; unbounded the trunk shakes, and more walks fall
    )
    unbend_radps: float = 0.4  # ours: slow, or the fall gets back what was taken from it

    def __post_init__(self) -> None:
        for name in ("blend_s", "attitude_s", "forget_s"):
            if not getattr(self, name) > 0.0:
                raise ConfigError(f"balance: {name}={getattr(self, name)} must be positive")
        check_ranges(
            "balance",
            self,
            tilt_gain=(0.0, 10.0),
            gyro_gain_s=(0.0, 10.0),
            standing_share=(0.0, 1.0),
            due_share=(0.0, 1.0),
            touch_n=(0.0, math.inf),
            hold_most_m=(0.0, 0.1),
            light_n=(0.0, math.inf),
            lower_mps=(0.0, 10.0),
            lower_most_m=(0.0, 0.1),
            wait_s=(0.0, 10.0),
            inward_m=(-0.1, 0.1),
            astray_m=(0.0, 1.0),
            answer=(0.0, 10.0),
            tipping_m=(0.0, 1.0),
            put_down_mps=(0.0, 10.0),
            bend_rad_per_m=(0.0, 100.0),
            bend_most_rad=(0.0, 1.0),
            bend_radps=(0.0, 20.0),
            bend_radps2=(0.0, math.inf),
            unbend_radps=(0.0, 20.0),
        )
        if not 0.0 <= self.tilt_memory < 1.0:
            raise ConfigError(f"balance: tilt_memory={self.tilt_memory} must lie in [0, 1)")


class Attitude:
    """The vertical in the trunk, from gyro and accelerometer alone.

    The acceleration that the walk itself plans is taken off the accelerometer first: the sway of a step
    would otherwise lean the vertical by degrees.

    Source: Mahony et al. 2008 (complementary filter that learns the gyro's bias).
    """

    def __init__(self, config: BalanceConfig, tick_s: float) -> None:
        self.up = np.array([0.0, 0.0, 1.0])
        self._bias = np.zeros(3)
        self._tick_s = tick_s
        self._share = tick_s / config.attitude_s
        self._learn = tick_s / (4.0 * config.attitude_s**2)  # as slow as does not ring

    def feel(
        self,
        rate: Float[np.ndarray, "3"],
        force: Float[np.ndarray, "3"],
        planned: Float[np.ndarray, "2"],
    ) -> None:
        """One tick of the sensor.

        Args:
            rate, force: Trunk axes, rad/s and m/s^2.
            planned: Acceleration of the weight along and across the body, m/s^2.
        """
        rest = force.copy()
        rest[:2] -= planned
        attend(self.up, self._bias, rate, rest, self._tick_s, self._share, self._learn)

    @property
    def tilt(self) -> Float[np.ndarray, "2"]:
        """Roll and pitch, rad."""
        x, y, z = (float(v) for v in self.up)
        return np.array([math.atan2(y, z), math.atan2(-x, math.hypot(y, z))])

    def turning(self, rate: Float[np.ndarray, "3"]) -> float:
        """How fast the heading changes, rad/s, at a rate in trunk axes."""
        roll, pitch = self.tilt.tolist()
        return float((math.sin(roll) * rate[1] + math.cos(roll) * rate[2]) / math.cos(pitch))

    def level(self) -> Float[np.ndarray, "3 3"]:
        """Rotation from the trunk to upright axes of the same heading."""
        return tilted(self.tilt)


class Ankles:
    """Tilt to the ankles of the feet that stand."""

    def __init__(self, config: BalanceConfig, tick_s: float) -> None:
        self._config = config
        self._pace = tick_s / config.blend_s
        self._tilt = np.zeros(2)
        self._part = np.ones(2)  # left, right
        self._damped = config.standing_share  # of the gyro's part

    def correct(
        self,
        angles: Float[np.ndarray, "12"],
        tilt: Float[np.ndarray, "2"],
        rate: Float[np.ndarray, "2"],
        swinging: int,
        walks: bool,
    ) -> None:
        """Add to ankle pitch and roll, in place.

        The gyro takes its full part while the body walks: one that stands would tremble with its noise.

        Args:
            angles: Of the legs.
            tilt, rate: Roll and pitch of the body, but for what its trunk is bent at the hips, rad and rad/s.
            swinging: The side in the air, +1 left, -1 right, 0 none.
            walks: Whether this step steps.
        """
        full = 1.0 if walks else self._config.standing_share
        self._damped += min(max(full - self._damped, -self._pace), self._pace)
        keep = self._config.tilt_memory
        self._tilt = keep * self._tilt + (1.0 - keep) * tilt
        damping = self._damped * self._config.gyro_gain_s
        roll, pitch = self._config.tilt_gain * self._tilt + damping * rate
        for k, side in enumerate((1, -1)):
            wanted = 0.0 if swinging == side else 1.0
            step = min(max(wanted - self._part[k], -self._pace), self._pace)
            self._part[k] += step
            angles[6 * k + 4] += self._part[k] * pitch
            angles[6 * k + 5] += self._part[k] * roll


class Landing:
    """How much higher, or lower, than planned each sole is kept, m."""

    def __init__(self, config: BalanceConfig, tick_s: float, scale: float = 1.0) -> None:
        self._config = config
        self._tick_s = tick_s
        self._fade = math.exp(-tick_s / config.forget_s)
        self._scale = scale
        self.heights = np.zeros(2)  # left, right
        self._held: list[float | None] = [None, None]
        self._waited = 0
        self._hurried = False

    def asks(self, step: Step, tick: int) -> int:
        """The side whose sole is to be felt at this tick, +1 left, -1 right, 0 none."""
        if not step.stepping:
            return 0
        if tick < step.double_support_ticks:
            return -step.swing
        share = (tick - step.double_support_ticks) / (step.ticks - step.double_support_ticks)
        return step.swing if self._hurried or share > self._config.due_share else 0

    def hurry(self) -> None:
        """Put the swing foot down now, wherever it is."""
        self._hurried = True

    def stays(self, step: Step) -> bool:
        """Whether the swing foot was put down in a hurry, and stands."""
        return self._hurried and self._held[0 if step.swing > 0 else 1] is not None

    def advance(self, step: Step, tick: int, load_n: float) -> None:
        """One tick.

        Args:
            step: In which the robot is.
            tick: Which tick of it.
            load_n: On the sole asked for.
        """
        config = self._config
        if tick < step.double_support_ticks:
            self._hurried = False
        asked = self.asks(step, tick)
        for k, side in enumerate((1, -1)):
            swinging = step.stepping and tick >= step.double_support_ticks and side == step.swing
            if not swinging:
                self.heights[k] *= self._fade
                self._held[k] = None
            if side != asked:
                continue
            if swinging:
                self._hold(k, float(step.lift[tick]), load_n)
            elif load_n < config.light_n:
                lower = self.heights[k] - config.lower_mps * self._tick_s * self._scale
                self.heights[k] = max(lower, -config.lower_most_m * self._scale)

    def waits(self, step: Step, tick: int, load_n: float) -> bool:
        """Whether time stands still at the begin of a double support: the new foot bears nothing yet.

        A body that leans outward over its standing foot comes back by itself, if the weight is not shifted
        onto a foot in the air meanwhile.
        """
        late = step.stepping and tick == 0 and load_n < self._config.touch_n
        if late and self._waited < self._config.wait_s / self._tick_s:
            self._waited += 1
            return True
        if tick > 0:
            self._waited = 0
        return False

    def _hold(self, k: int, lift: float, load_n: float) -> None:
        """Once felt, the sole stays at that height, whatever was planned."""
        config, held = self._config, self._held[k]
        if held is None:
            if load_n > config.touch_n:
                self._held[k] = lift + self.heights[k]
            elif self._hurried:
                lower = self.heights[k] - config.put_down_mps * self._tick_s * self._scale
                self.heights[k] = max(lower, -lift - config.lower_most_m * self._scale)
        elif self._hurried:
            self.heights[k] = held - lift
        else:
            most = config.hold_most_m * self._scale
            self.heights[k] = min(max(held - lift, self.heights[k]), most)
