"""The eight stages of the monocular cycle (seed 000) as one image."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import UInt8

from perception.monocular.result import MonocularResult

SIDE_PX = 360


def panes(
    result: MonocularResult, chosen_px: tuple[int, int] | None = None
) -> tuple[tuple[str, UInt8[np.ndarray, "h w 3"]], ...]:
    """Title and image of the eight stages of a cycle.

    Args:
        result: The cycle.
        chosen_px: Pixel (u, v) that the robot walks to, if any; marked in the result.
    """
    current = result.current.rgb
    previous = current if result.previous is None else result.previous.rgb
    faint = (0.5 * current + 110).astype(np.uint8)
    flows, smallest, predicted = faint.copy(), faint.copy(), current.copy()
    chosen = {o.flow for o in result.obstacles if o.flow >= 0}
    for k in range(len(result.flows)):
        begin, end = (
            tuple(np.rint(p[k]).astype(int).tolist())
            for p in (result.flows.previous, result.flows.current)
        )
        colour = (200, 0, 0) if result.flows.obstacle[k] >= 0 else (120, 120, 120)
        cv2.arrowedLine(flows, begin, end, colour, 2, tipLength=0.3)
        if k in chosen:
            cv2.arrowedLine(smallest, begin, end, (200, 0, 0), 3, tipLength=0.3)
    predicted[result.predicted > 0] = (230, 40, 40)
    for obstacle in result.obstacles:
        colour = (230, 40, 40) if obstacle.moving else (30, 60, 220)
        for image in (smallest, predicted):
            cv2.polylines(image, [obstacle.edge.astype(np.int32)], False, colour, 2)
    grey = [
        cv2.cvtColor(image, cv2.COLOR_GRAY2RGB)
        for image in (
            result.ground,
            np.asarray(cv2.dilate(result.edges, np.ones((3, 3), np.uint8))),
            result.movable,
        )
    ]
    if chosen_px is not None:
        cv2.drawMarker(grey[2], chosen_px, (200, 0, 0), cv2.MARKER_TILTED_CROSS, 30, 5)
    return (
        ("A previous", previous),
        ("B current", current),
        ("C ground", grey[0]),
        ("D edges", grey[1]),
        ("E optical flow", flows),
        ("F smallest flow", smallest),
        ("G prediction", predicted),
        ("H result", grey[2]),
    )


def stages(
    result: MonocularResult, chosen_px: tuple[int, int] | None = None
) -> UInt8[np.ndarray, "h w 3"]:
    """The eight panes of a cycle as one image, in two rows."""
    shown = []
    for title, image in panes(result, chosen_px):
        pane = cv2.resize(image, (SIDE_PX, SIDE_PX * image.shape[0] // image.shape[1]))
        cv2.rectangle(pane, (0, 0), (SIDE_PX // 2, 24), (255, 255, 255), -1)
        cv2.putText(pane, title, (6, 18), cv2.FONT_HERSHEY_SIMPLEX, 0.55, (0, 0, 0), 1, cv2.LINE_AA)
        shown.append(cv2.copyMakeBorder(pane, 2, 2, 2, 2, cv2.BORDER_CONSTANT, value=(90, 90, 90)))
    return np.asarray(np.vstack([np.hstack(shown[:4]), np.hstack(shown[4:])]), dtype=np.uint8)
