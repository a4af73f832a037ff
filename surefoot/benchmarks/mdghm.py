"""SIFT with directions by Gaussian-Hermite moments, against OpenCV's SIFT, with and without upsampling.

OpenCV's SIFT always doubles the image first. A peer without that gets the image at half size, which it doubles to the
image itself: the hardest peer of ours without upsampling.
"""

from __future__ import annotations

from functools import partial

import cv2
import numpy as np
from jaxtyping import UInt8

from perception.features.matching import match
from perception.features.mdghm_sift import Features, SiftConfig, detect

from .benchmark import Benchmark, Comparison, mean_ratio, race

SIZES = ((640, 480), (176, 144))
MOMENTS, NO_UPSAMPLING = SiftConfig(), SiftConfig(upsample=False)
RIGHT_PX = 2.0


def picture(width: int, height: int, rng: np.random.Generator) -> UInt8[np.ndarray, "h w"]:
    """Objects of all sizes in front of a textured wall, with camera noise."""
    grey = np.full((height, width), 110.0)
    for octave in range(1, 6):
        grain = rng.normal(0.0, 10.0, (height // 2**octave + 2, width // 2**octave + 2))
        grey += cv2.resize(grain, (width, height), interpolation=cv2.INTER_CUBIC)
    for _ in range(width * height // 3000):
        x, y = int(rng.integers(width)), int(rng.integers(height))
        size = tuple(int(s) for s in rng.integers(3, width // 12, 2))
        tone, turn = float(rng.uniform(20.0, 230.0)), float(rng.uniform(0.0, 180.0))
        corners = cv2.boxPoints(((float(x), float(y)), (float(size[0]), float(size[1])), turn))
        cv2.fillConvexPoly(grey, corners.astype(np.int32), tone)
    grey = cv2.GaussianBlur(grey, (0, 0), 0.7) + rng.normal(0.0, 2.0, grey.shape)
    return np.clip(np.rint(grey), 0, 255).astype(np.uint8)


def right_share(first: Features, second: Features, affine: np.ndarray) -> float:
    """Of the matches of two pictures of one plane, the share that is right."""
    pairs = match(first.descriptors, second.descriptors)
    moved = first.pixels[pairs[:, 0]] @ affine[:, :2].T + affine[:, 2]
    off = np.linalg.norm(moved - second.pixels[pairs[:, 1]], axis=1)
    return float(np.mean(off < RIGHT_PX)) if len(pairs) else 0.0


def run() -> Comparison:
    """Both sizes; ratios are geometric means. Accuracy: right matches after a turn of 40 deg."""
    rng = np.random.default_rng(0)
    peer = cv2.SIFT.create()
    times: dict[str, float] = {}
    with_all, without, half = [], [], []
    accuracy: dict[str, float] = {}
    for width, height in SIZES:
        image = picture(width, height, rng)
        taken = race(
            {
                "ours": partial(detect, image, MOMENTS),
                "ours_no_upsampling": partial(detect, image, NO_UPSAMPLING),
                "cv2": partial(peer.detectAndCompute, image, None),
                "cv2_half": partial(_at_half_size, peer, image),
            },
            rounds=7,
        )
        times.update({f"{name}_{width}x{height}_ms": ms for name, ms in taken.items()})
        with_all.append(taken["ours"] / taken["cv2"])
        without.append(taken["cv2"] / taken["ours_no_upsampling"])
        half.append(taken["cv2_half"] / taken["ours_no_upsampling"])
        affine = cv2.getRotationMatrix2D((width / 2, height / 2), 40.0, 1.0)
        turned = cv2.warpAffine(image, affine, (width, height), borderMode=cv2.BORDER_REFLECT)
        for name, config in (("ours", MOMENTS), ("cv2", SiftConfig(method="opencv"))):
            both = detect(image, config), detect(turned, config)
            accuracy[f"{name}_keypoints_{width}x{height}"] = float(len(both[0]))
            accuracy[f"{name}_right_share_{width}x{height}"] = right_share(*both, affine)
        accuracy[f"right_share_below_cv2_{width}x{height}"] = (
            accuracy[f"cv2_right_share_{width}x{height}"]
            - accuracy[f"ours_right_share_{width}x{height}"]
        )
    ratio = mean_ratio(with_all)
    ratios = {
        "ratio_sift_time": ratio,  # ours over the peer's: smaller is better
        "ratio_sift_speed": 1.0 / ratio,
        "ratio_no_upsampling": mean_ratio(without),
        "ratio_half_size": mean_ratio(half),
    }
    fair = {
        "cv2.SIFT, both with upsampling": ratios["ratio_sift_speed"],
        "cv2.SIFT at half size, both without upsampling": ratios["ratio_half_size"],
    }
    return Comparison(times, ratios, accuracy, fair)


def _at_half_size(peer: cv2.SIFT, image: UInt8[np.ndarray, "h w"]) -> object:
    half = cv2.resize(image, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    return peer.detectAndCompute(half, None)


BENCHMARK = Benchmark(
    "mdghm",
    "MDGHM-SIFT at 640x480 and 176x144, against cv2.SIFT",
    run,
    {"ratio_sift_speed": 0.8, "ratio_no_upsampling": 1.4},
    {f"right_share_below_cv2_{width}x{height}": 0.02 for width, height in SIZES},
)
