"""Lengths and counts that size arrays are bounded: a wrong unit is refused before the memory is full."""

from __future__ import annotations

import pytest

from mapping.grid.egocentric_grid import GridConfig
from mapping.ground.config import GroundConfig
from mapping.objects.footprints import FootprintConfig
from perception.floor.hough import HoughConfig
from perception.primitives.errors import ConfigError
from planning.swarm.search import SwarmConfig
from sim.sensors.cameras import ImageConfig
from sim.sensors.depth_camera import DepthCameraConfig
from sim.sensors.tof_camera import TofConfig


@pytest.mark.parametrize(
    ("part", "values"),
    [
        (GridConfig, {"side_m": 3550.05}),
        (GroundConfig, {"reach_m": 3000.0}),
        (FootprintConfig, {"gap_m": 80.0}),
        (HoughConfig, {"triples": 10**9}),
        (SwarmConfig, {"particles": 10**9}),
        (ImageConfig, {"width": 10_000, "height": 10_000}),
        (DepthCameraConfig, {"width": 10_000}),
        (TofConfig, {"height": 10_000}),
    ],
)
def test_a_setting_in_a_wrong_unit_is_refused(part, values):
    with pytest.raises(ConfigError, match=f"{next(iter(values))}=.* at most"):
        part(**values)
