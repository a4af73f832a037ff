"""The four panes of seed 004: camera image, range image, panorama, and obstacles in three dimensions.

Source: seed 004, Fig. 6.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, UInt8

from mapping.panorama.obstacles import Surroundings
from mapping.panorama.stitching import Panorama
from mapping.panorama.views import View
from planning.avoidance.choice import Choice

from . import style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from planning.planners.avoidance_planner import Look

FARTHEST_M = 3.0
STRIDE = 7  # only every seventh point is shown in 3-D


def four_panes(
    picture: UInt8[np.ndarray, "h w 3"] | None,
    views: Sequence[View],
    panorama: Panorama,
    around: Surroundings,
    choice: Choice | None,
) -> Figure:
    """Panes of one panoramic scan.

    Args:
        picture: Image of the colour camera, if there is one.
        views: Views of the panorama; the one that looks straight ahead is shown.
        panorama: The panorama of these views.
        around: Its obstacles and gaps.
        choice: The decision; None if the path is free.
    """
    from matplotlib.figure import Figure

    with style.styled():
        figure = Figure(figsize=(style.WIDTH_IN, 6.0), layout="constrained")
        webcam, tof = figure.add_subplot(2, 2, 1), figure.add_subplot(2, 2, 2)
        pem = figure.add_subplot(2, 2, 3)
        space = figure.add_subplot(2, 2, 4, projection="3d")
        if picture is not None:
            webcam.imshow(picture)
        webcam.set_title("Camera")
        level = min(views, key=_off_axis)
        tof.imshow(level.depth.z, cmap="viridis_r", vmin=0.0, vmax=FARTHEST_M)
        tof.set_title("Time of flight, m")
        if panorama.drawing is not None:
            pem.imshow(panorama.drawing.range_m, cmap="viridis_r", vmin=0.0, vmax=FARTHEST_M)
        pem.set_title("Panoramic environment map")
        for axes in (webcam, tof, pem):
            axes.grid(False)
            axes.set_axis_off()
        points = _points(views, panorama)
        space.scatter(
            points[:, 0], points[:, 1], points[:, 2], c=points[:, 2], s=0.6, vmin=0.0, vmax=0.6
        )
        for one in around.obstacles:
            (ax, ay), (bx, by), h = one.left_edge_m, one.right_edge_m, one.height_m
            space.plot(
                [ax, bx, bx, ax, ax], [ay, by, by, ay, ay], [0, 0, h, h, 0], color=style.WRONG
            )
        if choice is not None:
            at = choice.pivot
            space.plot([0.0, at.x_m], [0.0, at.y_m], [0.0, 0.0], "o-", color=style.TARGET)
            figure.suptitle(choice.why, fontsize=8.0, wrap=True)
        space.set(xlim=(0, 2.5), ylim=(-1.5, 1.5), zlim=(0, 1.0), title="Obstacles")
        space.set_xlabel("x, m")
        space.set_ylabel("y, m")
        space.view_init(elev=40.0, azim=-160.0)
        return figure


def png_of(look: Look) -> bytes:
    """The four panes of one panoramic scan of a walk (`AvoidancePlanner.looks`) as PNG."""
    data = io.BytesIO()
    figure = four_panes(look.picture, look.views, look.panorama, look.around, look.choice)
    with style.styled():
        figure.savefig(data, dpi=110, format="png")
    return data.getvalue()


def _off_axis(view: View) -> float:
    """Angular distance of a view from straight ahead, as a chord length."""
    if view.prior is None:
        return 2.0
    return float(np.linalg.norm(view.prior.rotation[:, 2] - np.array([1.0, 0.0, 0.0])))


def _points(views: Sequence[View], panorama: Panorama) -> Float[np.ndarray, "n 3"]:
    """Nearby points of all views, base frame, m."""
    found = [np.zeros((0, 3))]
    for view, placed in zip(views, panorama.placed, strict=True):
        if placed is None:
            continue
        z = view.depth.z.astype(np.float64)[..., None]
        cloud = placed.T_base_camera.apply((view.depth.camera.rays * z).reshape(-1, 3)[::STRIDE])
        near = np.all(np.isfinite(cloud), axis=1) & (cloud[:, 0] < 2.5)
        found.append(cloud[near & (np.abs(cloud[:, 1]) < 1.5) & (cloud[:, 2] < 1.0)])
    return np.concatenate(found)
