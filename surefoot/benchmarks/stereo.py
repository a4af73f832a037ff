"""Stereo with reliability, against OpenCV's StereoBM, on synthetic pairs of known disparity.

The time of ours includes sub-pixel disparity, reliability and standard deviation. StereoBM returns disparity and
discards pixels by its own filters; wrong pixels are counted at the coverage of StereoBM.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import cv2
import numpy as np
from jaxtyping import Float32

from perception.depth import stereo
from perception.primitives.camera import Camera
from perception.primitives.frame import StereoView

from .benchmark import Benchmark, Comparison, race

SIZES = ((320, 240), (640, 480))
SEARCHES = (32, 64, 96, 128)
MAIN = (640, 480, 64)
BM_BLOCK_PX = 15
WRONG_PX = 1.0
NOISE_GREY = 2.0
BASELINE_M = 0.1


def synthetic(
    width: int, height: int, steps: int, rng: np.random.Generator
) -> tuple[StereoView, Float32[np.ndarray, "h w"]]:
    """A slanted floor, a wall and boxes, with texture of many octaves and noise in both images.

    Returns:
        The pair, and the disparity of each left pixel, px.
    """
    v, u = np.mgrid[0:height, 0:width].astype(np.float32)
    near = np.float32(0.8 * steps)
    truth = np.maximum(np.float32(0.2 * steps), near * v / height)
    for _ in range(6):
        x, y = rng.integers(0, width), rng.integers(height // 8, height)
        w, h = int(width * rng.uniform(0.08, 0.25)), int(height * rng.uniform(0.1, 0.4))
        block = np.s_[y : y + h, x : x + w]
        truth[block] = np.maximum(truth[block], np.float32(rng.uniform(0.3, 0.9) * steps))
    right = _texture(width, height, rng)
    # The left image is the right one shifted by the disparity; nearer surfaces cover farther ones.
    left = cv2.remap(right, u - truth, v, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
    hidden = np.zeros(truth.shape, dtype=bool)
    for d in range(1, steps):  # a nearer surface is on the same ray of the right camera
        shifted = np.full_like(truth, -1.0)
        shifted[:, : width - d] = truth[:, d:]
        hidden |= np.abs(shifted - truth - d) < 0.5
    left[hidden] = _texture(width, height, rng)[hidden]
    pair = [
        np.clip(image + rng.normal(0.0, NOISE_GREY, truth.shape), 0, 255).astype(np.uint8)
        for image in (left, right)
    ]
    focal = BASELINE_M**-1 * steps * stereo.StereoConfig().nearest_m  # the search ends at nearest_m
    camera = Camera(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2)
    return StereoView(pair[0], pair[1], BASELINE_M, camera), truth


def _texture(width: int, height: int, rng: np.random.Generator) -> Float32[np.ndarray, "h w"]:
    image = np.full((height, width), 128.0, np.float32)
    for octave in range(6):
        coarse = rng.normal(size=(max(height >> octave, 2), max(width >> octave, 2)))
        image += 10.0 * cv2.resize(
            coarse.astype(np.float32), (width, height), interpolation=cv2.INTER_CUBIC
        )
    return image


def run() -> Comparison:
    """Two image sizes, four search ranges; about 20 s. OpenCV runs in one thread, as ours."""
    rng = np.random.default_rng(0)
    times: dict[str, float] = {}
    ratios: list[float] = []
    accuracy: dict[str, float] = {}
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        for width, height in SIZES:
            for steps in SEARCHES:
                view, truth = synthetic(width, height, steps, rng)
                config = replace(stereo.StereoConfig(), most_disparity_px=steps)
                peer = cv2.StereoBM.create(steps, BM_BLOCK_PX)
                taken = race(
                    {
                        "ours": partial(stereo.disparity, view, config),
                        "stereobm": partial(peer.compute, view.left, view.right),
                    },
                    rounds=9,
                )
                name = f"{width}x{height}x{steps}"
                times.update({f"{who}_{name}_ms": value for who, value in taken.items()})
                ratios.append(taken["stereobm"] / taken["ours"])
                if (width, height, steps) == MAIN:
                    main = ratios[-1]
                    accuracy = wrong(view, truth, config, peer)
    finally:
        cv2.setNumThreads(threads)
    means = {
        "ratio_stereobm_640x480x64": main,
        "ratio_stereobm_geomean": float(np.exp(np.mean(np.log(ratios)))),
    }
    return Comparison(times, means, accuracy)


def wrong(
    view: StereoView,
    truth: Float32[np.ndarray, "h w"],
    config: stereo.StereoConfig,
    peer: cv2.StereoBM,
) -> dict[str, float]:
    """Percentage of pixels with an error above one pixel, of both at the coverage of StereoBM."""
    theirs = peer.compute(view.left, view.right).astype(np.float32) / np.float32(16.0)
    kept = theirs >= 0.0
    found = stereo.disparity(view, config)
    order = np.argsort(-found.reliability.ravel(), kind="stable")[: int(kept.sum())]
    error = np.abs(found.disparity_px - truth).ravel()[order]
    ours_pct = 100.0 * float(np.mean(~(error <= WRONG_PX)))
    theirs_pct = 100.0 * float(np.mean(np.abs(theirs - truth)[kept] > WRONG_PX))
    return {
        "ours_wrong_pct": ours_pct,
        "stereobm_wrong_pct": theirs_pct,
        "coverage_pct": 100.0 * float(np.mean(kept)),
        "wrong_share": ours_pct / theirs_pct,
    }


BENCHMARK = Benchmark(
    "stereo",
    "Disparity with reliability and sigma, 32 to 128 disparities, against StereoBM",
    run,
    {"ratio_stereobm_640x480x64": 1.25, "ratio_stereobm_geomean": 1.0},
)
