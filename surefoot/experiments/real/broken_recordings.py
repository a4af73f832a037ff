"""Recordings broken on purpose: a stretch of the frames is spoilt as cameras, drivers and people spoil it.

Every break takes the frames of a stretch and returns what the odometry is given instead; the true poses stay those of
the frames.

Source: ours.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import cv2
import numpy as np
from jaxtyping import Float32, UInt8

from perception.primitives.frame import ColourView, DepthView, Frame

BLUR_SHARE = 0.08  # of the image width, over which a fast turn smears the pictures
SCALES = (1.1, 1.5)
"""Factors of depth, or their inverses: a driver that uses a wrong scale or wrong intrinsics for a while."""
CROWD_MPS = 1.2  # speed of people who walk by
CROWD_SHARE = (0.2, 0.8)  # of the image width covered by them
CROWD_M = (0.7, 1.5)  # distance from the camera

Break = Callable[[Sequence[Frame], float, np.random.Generator], list[Frame]]
"""Frames of the stretch, time between two of them in s, random numbers; returns the frames given instead."""


def blur(frames: Sequence[Frame], step_s: float, rng: np.random.Generator) -> list[Frame]:
    """Colour and depth smeared along the rows."""
    return [_changed(frame, *_smeared(*_pictures(frame))) for frame in frames]


def blackout(frames: Sequence[Frame], step_s: float, rng: np.random.Generator) -> list[Frame]:
    """A covered lens: no depth, a black picture."""
    return [
        _changed(frame, np.full_like(z, np.nan), np.zeros_like(rgb))
        for frame, (z, rgb) in ((frame, _pictures(frame)) for frame in frames)
    ]


def crowd(frames: Sequence[Frame], step_s: float, rng: np.random.Generator) -> list[Frame]:
    """People in textured clothes walk by in one direction, close to the camera."""
    camera = frames[0].depth.camera  # type: ignore[union-attr]
    share, near_m = rng.uniform(*CROWD_SHARE), rng.uniform(*CROWD_M)
    way = 1.0 if rng.random() < 0.5 else -1.0
    period = 0.5 * camera.fx / near_m  # half a metre from one person to the next, px
    clothes = cv2.resize(
        rng.integers(30, 220, (40, 400, 3), np.uint8),
        (12 * camera.width, camera.height),
        interpolation=cv2.INTER_LINEAR,
    )
    start = rng.uniform(0.0, 4.0 * camera.width)
    return [
        _changed(
            frame,
            *_in_front(
                *_pictures(frame),
                (near_m, share, period, start + way * CROWD_MPS * step_s * n * camera.fx / near_m),
                clothes,
            ),
        )
        for n, frame in enumerate(frames, start=1)
    ]


def wrong_scale(frames: Sequence[Frame], step_s: float, rng: np.random.Generator) -> list[Frame]:
    """Depth multiplied by a wrong factor."""
    factor = np.float32(rng.uniform(*SCALES) ** rng.choice((-1.0, 1.0)))
    return [
        _changed(frame, factor * z, rgb)
        for frame, (z, rgb) in ((frame, _pictures(frame)) for frame in frames)
    ]


def frozen(frames: Sequence[Frame], step_s: float, rng: np.random.Generator) -> list[Frame]:
    """The first picture again and again."""
    return [_changed(frame, *_pictures(frames[0])) for frame in frames]


def dropped(frames: Sequence[Frame], step_s: float, rng: np.random.Generator) -> list[Frame]:
    """No frames at all."""
    return []


BREAKS: dict[str, Break] = {
    "blur": blur,
    "blackout": blackout,
    "crowd": crowd,
    "wrong_scale": wrong_scale,
    "frozen": frozen,
    "dropped": dropped,
}


def _pictures(frame: Frame) -> tuple[Float32[np.ndarray, "h w"], UInt8[np.ndarray, "h w 3"]]:
    assert frame.depth is not None
    assert frame.colour is not None
    return frame.depth.depth, frame.colour.rgb


def _changed(frame: Frame, z: np.ndarray, rgb: np.ndarray) -> Frame:
    assert frame.depth is not None
    assert frame.colour is not None
    return replace(
        frame,
        depth=DepthView(z.astype(np.float32), frame.depth.camera),
        colour=ColourView(rgb, frame.colour.camera),
    )


def _smeared(z: np.ndarray, rgb: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    size = (round(BLUR_SHARE * z.shape[1]) | 1, 1)
    known = cv2.blur(np.isfinite(z).astype(np.float32), size)
    whole = cv2.blur(np.nan_to_num(z), size)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.where(known > 0.5, whole / known, np.nan)
    return mean, np.asarray(cv2.blur(rgb, size))


def _in_front(
    z: np.ndarray,
    rgb: np.ndarray,
    people: tuple[float, float, float, float],
    clothes: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """The pictures with people in front: distance, share covered, px from one to the next, px walked."""
    near_m, share, period, walked = people
    columns = np.arange(z.shape[1]) + walked
    across = (columns % period) / period / share  # 0 to 1 over one person
    bulge = np.sqrt(np.clip(1.0 - (2.0 * across - 1.0) ** 2, 0.0, 1.0))
    surface = near_m + 0.15 * (1.0 - bulge)  # a body is round
    body = np.broadcast_to((across < 1.0)[None, :], z.shape).copy()
    body[: z.shape[0] // 12] = False
    hidden = body & ~(z < surface[None, :])
    shown = clothes[:, np.floor(columns).astype(np.int64) % clothes.shape[1]][: z.shape[0]]
    return (
        np.where(hidden, surface[None, :], z).astype(np.float32),
        np.where(hidden[..., None], shown, rgb).astype(np.uint8),
    )
