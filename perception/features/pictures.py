"""Range and amplitude as grey pictures with contrast everywhere, so that features can be found in them.

Source: seed 004, section 2.2.1 as specified: range over 0 to d_max to 8 bit, with local contrast (CLAHE,
Zuiderveld 1994). The equalisation works on 16 bit, as 8 bit over 5 m would be steps of 2 cm.
"""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Float32, UInt8
from scipy import ndimage

from ..primitives.errors import InputError

CLIP_LIMIT = 4.0  # ours: how much a tile's contrast may grow
TILES = (8, 8)  # OpenCV's: tiles across and down


def range_picture(
    range_m: Float32[np.ndarray, "h w"], farthest_m: float
) -> UInt8[np.ndarray, "h w"]:
    """Range or depth as grey: 0 at 0 m, white at the farthest and beyond; holes take the nearest value.

    Args:
        range_m: m, NaN where there is none.
        farthest_m: d_max.
    """
    if not farthest_m > 0.0:
        raise InputError(f"picture: farthest_m={farthest_m} must be positive")
    return _equalised(_filled(range_m) / np.float32(farthest_m))


def amplitude_picture(amplitude: Float32[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w"]:
    """Amplitude of a time-of-flight camera as grey, by its logarithm: near is not all white."""
    logarithm = np.log(np.maximum(_filled(amplitude), np.float32(1e-3)))
    low, high = np.percentile(logarithm, (1.0, 99.0))
    return _equalised((logarithm - low) / max(float(high - low), 1e-3))


def _equalised(share: np.ndarray) -> UInt8[np.ndarray, "h w"]:
    fine = (np.clip(share, 0.0, 1.0) * 65535.0).astype(np.uint16)
    equal = cv2.createCLAHE(CLIP_LIMIT, TILES).apply(fine)
    return np.asarray(equal >> 8, dtype=np.uint8)


def _filled(image: Float32[np.ndarray, "h w"]) -> Float32[np.ndarray, "h w"]:
    known = np.isfinite(image)
    if known.all():
        return image
    if not known.any():
        return np.zeros_like(image)
    row, column = ndimage.distance_transform_edt(
        ~known, return_distances=False, return_indices=True
    )
    return np.asarray(image[row, column])
