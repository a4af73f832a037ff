"""A surface map that fuses each image in a second thread, while its caller prepares the next one.

Images are fused one after the other in the order of the calls, so the surface has the same bits.

Source: ours.
"""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor

import numpy as np
from jaxtyping import UInt8

from perception.primitives.frame import Depth
from perception.primitives.pose import Pose3

from .meshes import Mesh
from .tsdf_config import SurfaceMap


class Background:
    """A surface map like the given one, which nobody else may use meanwhile.

    Args:
        surface: Does the work.
    """

    def __init__(self, surface: SurfaceMap) -> None:
        self._surface = surface
        self._worker = ThreadPoolExecutor(1, "surface")
        self._fusing: Future[None] | None = None

    def integrate(
        self, depth: Depth, T_map_camera: Pose3, rgb: UInt8[np.ndarray, "h w 3"] | None = None
    ) -> None:
        """Fuse one image, once the one before is fused; the arrays must not change afterwards.

        Raises:
            InputError: The image before did not fit.
        """
        self._wait()
        self._fusing = self._worker.submit(self._surface.integrate, depth, T_map_camera, rgb)

    def mesh(self) -> Mesh:
        """The surface of all images, map frame; raises as `integrate`."""
        self._wait()
        return self._surface.mesh()

    def _wait(self) -> None:
        fusing, self._fusing = self._fusing, None
        if fusing is not None:
            fusing.result()
