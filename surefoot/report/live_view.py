"""A live 3-D page on the loopback interface: map, point cloud, robot and obstacles.

Panes beside the 3-D view show the camera image, the depth images and the last panorama, as in seed 004, Fig. 6.

Needs the extra `viz` (viser serves the page; it loads nothing from the network). The page only reads; the run
does not depend on it.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from perception.estimate import Estimate
from perception.primitives.errors import InputError
from perception.primitives.frame import Frame
from planning.planners.planner import Planner
from planning.world_model import WorldModel

from ..evaluation.metrics.obstacles import MOVING
from ..results.run_folder import RunFolder

HOST = "127.0.0.1"
PANE_PX = 320  # width of a pane
FARTHEST_M = 3.0  # darkest range in the panes, as in the report
CLOUD_POINTS = 60_000  # more make a browser slow
STATIC_RGB, MOVING_RGB = (230, 159, 0), (213, 94, 0)  # orange and vermilion, colour-blind safe
ROBOT_RGB, ROBOT_M = (0, 114, 178), (0.16, 0.2, 0.45)  # blue; a box about as large as the robot
CAMERA_BACK_M = (-1.8, -1.2, 1.6)  # first view of the scene, relative to the robot


class LivePage:
    """A page that shows the present state of a run."""

    def __init__(self, port: int = 8080) -> None:
        try:
            import viser
        except ImportError as error:
            raise InputError(
                "the live page needs viser, which is not installed; "
                "install it with: pip install 'surefoot[viz]'"
            ) from error
        self._server = viser.ViserServer(host=HOST, port=port, verbose=False)
        self._server.scene.set_up_direction("+z")
        self._robot = (0.0, 0.0)
        self._server.on_client_connect(self._look_at_robot)
        self._tracks: dict[int, Any] = {}
        self._panes: dict[str, Any] = {}

    @property
    def address(self) -> str:
        """URL of the page."""
        return f"http://{HOST}:{self._server.get_port()}"

    def show(self, frame: Frame, world: WorldModel, planner: Planner | None = None) -> None:
        """Draw the state after one cycle.

        Args:
            frame: Sensor data.
            world: Estimate of perception for this frame.
            planner: The planner; the panorama of one with panoramic scans (`looks`) is shown.
        """
        scene, estimate = self._server.scene, world.estimate
        self._show_panes(frame, estimate, planner)
        if estimate.pose is not None:
            x, y, yaw = (float(v) for v in estimate.pose.mean)
            half = yaw / 2
            scene.add_frame(
                "/robot",
                axes_length=0.25,
                axes_radius=0.012,
                wxyz=(math.cos(half), 0.0, 0.0, math.sin(half)),
                position=(x, y, 0.0),
            )
            scene.add_box(
                "/robot/body",
                color=ROBOT_RGB,
                dimensions=ROBOT_M,
                position=(0.0, 0.0, ROBOT_M[2] / 2),
            )
            self._robot = (x, y)
        seen = [view.upright for view in estimate.views]
        if seen:
            self._points("/now", np.concatenate(seen), None, 0.012)
        for obstacle in estimate.obstacles:
            colour = MOVING_RGB if obstacle.moving > MOVING else STATIC_RGB
            self._tracks[obstacle.track] = scene.add_icosphere(
                f"/tracks/{obstacle.track}",
                radius=max(obstacle.radius_m, 0.03),
                color=colour,
                position=(*obstacle.position.tolist(), obstacle.height_m / 2),
            )
        followed = {obstacle.track for obstacle in estimate.obstacles}
        for gone in [track for track in self._tracks if track not in followed]:
            self._tracks.pop(gone).remove()
        if world.grid is not None:
            grid = world.grid
            self.show_map(grid.probability, np.asarray(grid.origin), grid.cell_m)

    def _look_at_robot(self, client: Any) -> None:
        """Point the camera of a new browser window at the robot."""
        x, y = self._robot
        client.camera.position = (x + CAMERA_BACK_M[0], y + CAMERA_BACK_M[1], CAMERA_BACK_M[2])
        client.camera.look_at = (x + 0.5, y, 0.2)

    def _show_panes(self, frame: Frame, estimate: Estimate, planner: Planner | None) -> None:
        if frame.colour is not None:
            self._pane("Camera", frame.colour.rgb)
        for view in estimate.views:
            self._pane(f"Depth ({view.sensor})", _painted(view.depth.z))
        looks = getattr(planner, "looks", [])
        if looks and looks[-1].panorama.drawing is not None:
            self._pane("Panoramic environment map", _painted(looks[-1].panorama.drawing.range_m))

    def _pane(self, label: str, picture: UInt8[np.ndarray, "h w 3"]) -> None:
        height, width = picture.shape[:2]
        size = (PANE_PX, max(1, round(PANE_PX * height / width)))
        small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
        if label in self._panes:
            self._panes[label].image = small
        else:
            self._panes[label] = self._server.gui.add_image(small, label=label)

    def show_map(
        self, probability: Float[np.ndarray, "r c"], origin: Float[np.ndarray, "2"], cell_m: float
    ) -> None:
        """Draw an occupancy map on the floor; occupied cells are dark."""
        rows, columns = probability.shape
        grey = (255 * (1.0 - probability)).astype(np.uint8)
        width, height = columns * cell_m, rows * cell_m
        self._server.scene.add_image(
            "/map",
            np.repeat(grey[::-1, :, None], 3, axis=2),
            render_width=width,
            render_height=height,
            wxyz=(0.0, 1.0, 0.0, 0.0),  # images have y down: rotated onto the floor, face up
            position=(float(origin[0]) + width / 2, float(origin[1]) + height / 2, -0.005),
        )

    def show_cloud(
        self, points: Float[np.ndarray, "n 3"], colours: UInt8[np.ndarray, "n 3"] | None
    ) -> None:
        """Draw the point cloud of a whole run."""
        self._points("/cloud", points, colours, 0.015)

    def _points(
        self,
        name: str,
        points: Float[np.ndarray, "n 3"],
        colours: UInt8[np.ndarray, "n 3"] | None,
        size_m: float,
    ) -> None:
        stride = max(1, len(points) // CLOUD_POINTS)
        chosen = points[::stride].astype(np.float32)
        if colours is None:
            level = np.clip(chosen[:, 2] / 0.6, 0.0, 1.0)[:, None]
            colours = (level * [240, 160, 60] + (1 - level) * [70, 120, 160]).astype(np.uint8)
        else:
            colours = colours[::stride]
        self._server.scene.add_point_cloud(name, chosen, colours, point_size=size_m)


def _painted(range_m: Float[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w 3"]:
    """RGB image of ranges, as in the report: near is bright, missing range black."""
    there = np.isfinite(range_m)
    level = np.where(there, np.clip(1.0 - range_m / FARTHEST_M, 0.0, 1.0), 0.0)
    painted = cv2.applyColorMap((255 * level).astype(np.uint8), cv2.COLORMAP_VIRIDIS)[..., ::-1]
    return np.ascontiguousarray(painted * there[..., None])


def serve(folder: RunFolder, say: Callable[[str], None], stay: bool = True) -> LivePage:
    """Show map and point cloud of a run; returns only after an interrupt, unless `stay` is false."""
    from mapping.io import clouds, nav2

    page = LivePage()
    if folder.has("map.yaml"):
        probability, origin, cell_m = nav2.load(folder.path("map.yaml"))[:3]
        page.show_map(probability, np.asarray(origin)[:2], cell_m)
    if folder.has("cloud.ply"):
        page.show_cloud(*clouds.load_ply(folder.path("cloud.ply")))
    say(f"{page.address}   (stop with Ctrl-C)")
    while stay:
        time.sleep(1.0)
    return page
