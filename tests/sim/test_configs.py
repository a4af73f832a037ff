"""Values out of range are refused with name, value and range."""

from __future__ import annotations

import dataclasses
import math

import pytest

from perception.primitives.errors import ConfigError
from sim.body.dynamic.anatomy import ANATOMIES, gait_for, head_for
from sim.body.dynamic.balance import BalanceConfig
from sim.body.dynamic.config import DynamicConfig
from sim.body.gait import GaitConfig
from sim.body.head import HeadConfig
from sim.body.inertial import ImuConfig
from sim.body.kinematic import SlipConfig, SwayConfig
from sim.robot_config import RobotConfig
from sim.sensors.cameras import ImageConfig
from sim.sensors.tof_camera import TofConfig

CAMERA = ImageConfig(640, 480, 60.0, (0.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ("config", "name", "value"),
    [
        (CAMERA, "width", 0),
        (CAMERA, "height", -480),
        (CAMERA, "across_deg", 0.0),
        (CAMERA, "across_deg", 180.0),
        (CAMERA, "mount_m", (0.0, math.nan, 0.0)),
        (CAMERA, "noise_grey", math.nan),
        (TofConfig(), "width", 0),
        (TofConfig(), "height", 1),
        (TofConfig(), "across_deg", 180.0),
        (TofConfig(), "down_deg", 0.0),
        (TofConfig(), "modulation_hz", math.inf),
        (TofConfig(), "sub_rays", 0),
        (TofConfig(), "noise_m", math.nan),
        (TofConfig(), "stray_share", 1.5),
        (TofConfig(), "bits", 0),
        (GaitConfig(), "com_height_m", 0.0),
        (GaitConfig(), "com_height_m", -0.2),
        (GaitConfig(), "lift_m", -0.01),
        (GaitConfig(), "zmp_inward_m", 0.05),
        (GaitConfig(), "forward_limit_m", -0.1),
        (GaitConfig(), "turn_limit_deg", math.nan),
        (GaitConfig(), "single_support_s", (0.001, 0.6)),
        (GaitConfig(), "double_support_s", (0.1, math.inf)),
        (HeadConfig(), "hip_m", 0.0),
        (HeadConfig(), "hip_m", -0.2),
        (HeadConfig(), "pan_deg", -10.0),
        (HeadConfig(), "tilt_deg", (0.0, 120.0)),
        (HeadConfig(), "encoder_deg", -0.1),
        (ImuConfig(), "gyro_bias_radps", math.nan),
        (SlipConfig(), "forward_mean_m", -1.0),
        (SlipConfig(), "turn_sigma_deg", -0.1),
        (SwayConfig(), "standing_share", 2.0),
        (DynamicConfig(), "bump_m", 0.06),
        (DynamicConfig(), "backlash_deg", 11.0),
        (DynamicConfig(), "offset_deg", math.nan),
        (DynamicConfig(), "scale", 0.0),
        (DynamicConfig(), "scale", -1.0),
        (DynamicConfig(), "scale", 11.0),
        (BalanceConfig(), "wait_s", -1.0),
        (BalanceConfig(), "deadband_m", -0.1),
        (GaitConfig(), "rescue_back_m", -0.1),
        (RobotConfig(), "baseline_m", 4.0),
        (RobotConfig(), "tof_mount_m", (math.inf, 0.0, 0.0)),
    ],
)
def test_values_out_of_range_are_refused(config, name, value):
    with pytest.raises(ConfigError, match=rf"{name}=\(?[-\w.]+.* must "):
        dataclasses.replace(config, **{name: value})


@pytest.mark.parametrize("anatomy", ANATOMIES)
@pytest.mark.parametrize("scale", [0.5, 1.0, 2.0])
def test_every_anatomy_is_within_the_ranges(anatomy, scale):
    body = DynamicConfig(anatomy=anatomy, scale=scale).body
    assert gait_for(body, GaitConfig()).com_height_m > 0.5 * GaitConfig().com_height_m - 1e-9
    assert head_for(body, HeadConfig()).hip_m == body.hip_m
