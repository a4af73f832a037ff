"""The factory of surface maps."""

from __future__ import annotations

from .tsdf import Tsdf
from .tsdf_config import SurfaceMap, TsdfConfig


def surface_map(config: TsdfConfig | None = None) -> SurfaceMap:
    """An empty map of the configured method."""
    config = config or TsdfConfig()
    if config.method == "open3d":
        from .tsdf_open3d import Open3dMap

        return Open3dMap(config)
    return Tsdf(config)
