"""Stereo with reliability, against OpenCV's StereoBM, on synthetic pairs of known disparity.

The time of ours includes sub-pixel disparity, reliability and standard deviation. StereoBM returns disparity and
discards pixels by its own filters; wrong pixels are counted at the coverage of StereoBM. The hardest peers: StereoBM at
the main size; StereoBM of all columns, as ours gives them, which takes a wider image since it skips as many columns as it
searches disparities; and the fastest semi-global matching of OpenCV, whose error is judged at its own coverage.
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

from .benchmark import Benchmark, Comparison, mean_ratio, race

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
    """Two image sizes, four search ranges; about 20 s."""
    rng = np.random.default_rng(0)
    times: dict[str, float] = {}
    ratios: list[float] = []
    whole: list[float] = []
    smooth: list[float] = []
    accuracy: dict[str, float] = {}
    for width, height in SIZES:
        for steps in SEARCHES:
            view, truth = synthetic(width, height, steps, rng)
            config = replace(stereo.StereoConfig(), most_disparity_px=steps)
            peer = cv2.StereoBM.create(steps, BM_BLOCK_PX)
            global_ = semi_global(steps)
            taken = race(
                {
                    "ours": partial(stereo.disparity, view, config),
                    "stereobm": partial(peer.compute, view.left, view.right),
                    "stereobm_all": partial(_all_columns, peer, view, steps),
                    "sgbm": partial(global_.compute, view.left, view.right),
                },
                rounds=9,
            )
            name = f"{width}x{height}x{steps}"
            times.update({f"{who}_{name}_ms": value for who, value in taken.items()})
            ratios.append(taken["stereobm"] / taken["ours"])
            whole.append(taken["stereobm_all"] / taken["ours"])
            smooth.append(taken["sgbm"] / taken["ours"])
            if (width, height, steps) == MAIN:
                main = ratios[-1]
                accuracy = wrong(view, truth, config, peer, "stereobm")
                accuracy |= wrong(view, truth, config, global_, "sgbm")
    means = {
        "ratio_stereobm_640x480x64": main,
        "ratio_stereobm_geomean": mean_ratio(ratios),
        "ratio_stereobm_all_columns": mean_ratio(whole),
        "ratio_sgbm_geomean": mean_ratio(smooth),
    }
    fair = {
        "StereoBM at 640x480x64": main,
        "StereoBM of all columns": means["ratio_stereobm_all_columns"],
        "StereoSGBM in 3 ways": means["ratio_sgbm_geomean"],
    }
    return Comparison(times, means, accuracy, fair)


def _all_columns(peer: cv2.StereoBM, view: StereoView, steps: int) -> object:
    left, right = (
        cv2.copyMakeBorder(image, 0, 0, steps, 0, cv2.BORDER_REPLICATE)
        for image in (view.left, view.right)
    )
    return peer.compute(left, right)


def semi_global(steps: int) -> cv2.StereoSGBM:
    """OpenCV's semi-global matching in its fastest mode, with the penalties of its documentation."""
    block = 5
    return cv2.StereoSGBM.create(
        0,
        steps,
        block,
        8 * block**2,
        32 * block**2,
        disp12MaxDiff=1,
        uniquenessRatio=10,
        speckleWindowSize=100,
        speckleRange=2,
        mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY,
    )


def wrong(
    view: StereoView,
    truth: Float32[np.ndarray, "h w"],
    config: stereo.StereoConfig,
    peer: cv2.StereoMatcher,
    name: str,
) -> dict[str, float]:
    """Percentage of pixels with an error above one pixel, of both at the coverage of the peer."""
    theirs = peer.compute(view.left, view.right).astype(np.float32) / np.float32(16.0)
    kept = theirs >= 0.0
    found = stereo.disparity(view, config)
    order = np.argsort(-found.reliability.ravel(), kind="stable")[: int(kept.sum())]
    error = np.abs(found.disparity_px - truth).ravel()[order]
    ours_pct = 100.0 * float(np.mean(~(error <= WRONG_PX)))
    theirs_pct = 100.0 * float(np.mean(np.abs(theirs - truth)[kept] > WRONG_PX))
    return {
        f"ours_wrong_pct_at_{name}": ours_pct,
        f"{name}_wrong_pct": theirs_pct,
        f"{name}_coverage_pct": 100.0 * float(np.mean(kept)),
        f"wrong_share_of_{name}": ours_pct / theirs_pct,
    }


BENCHMARK = Benchmark(
    "stereo",
    "Disparity with reliability and sigma, 32 to 128 disparities, against StereoBM",
    run,
    {"ratio_stereobm_640x480x64": 1.25, "ratio_stereobm_geomean": 1.0},
    {"wrong_share_of_stereobm": 0.5},
)
