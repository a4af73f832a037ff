"""Covariances that remain after the best rigid motion of a whole trajectory.

Alignment with the truth removes a part of every error; the covariance must lose the same part. That needs the
covariances between poses, which files and filters do not give. Two cases are known: errors that poses share because
they accumulate, and errors that are independent from pose to pose.

Source: Baarda 1973 (covariances after a change of gauge); the two cases are ours.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float


def without_gauge(
    moves: Float[np.ndarray, "n k g"],
    best: Float[np.ndarray, "n g k"],
    shared: Float[np.ndarray, "n k k"] | None = None,
    carry: Float[np.ndarray, "n k k"] | None = None,
    own: Float[np.ndarray, "n k k"] | None = None,
) -> Float[np.ndarray, "n k k"]:
    """Covariances of e_i - A_i sum of G_j e_j.

    Args:
        moves: A_i, the error of pose i by a small motion of the whole trajectory.
        best: G_i, its share in the least-squares estimate of that motion.
        shared: Covariances of accumulated errors. Two poses are assumed to share all of the error of the more
            certain one: errors of odometry steps are independent, and a pose inherits the error of an older one.
        carry: Maps an error at a common point to the error at pose i, where accumulated errors only grow; None: one.
        own: Covariances of errors that are independent from pose to pose.
    """
    left = np.zeros((*moves.shape[:2], moves.shape[1]))
    if own is not None:
        together = np.einsum("nij,njk,nlk->il", best, own, best)
        left += _less(own, moves, own @ best.transpose(0, 2, 1), together)
    if shared is not None:
        if carry is None:
            carry = np.broadcast_to(np.eye(moves.shape[1]), shared.shape)
        back = np.linalg.inv(carry)
        accumulated = back @ shared @ back.transpose(0, 2, 1)
        order = np.argsort(np.trace(accumulated, axis1=1, axis2=2), kind="stable")
        accumulated, parts = accumulated[order], (best @ carry)[order]
        until = np.cumsum(accumulated @ parts.transpose(0, 2, 1), axis=0)
        later = np.cumsum(parts[::-1], axis=0)[::-1] - parts
        cross = until + accumulated @ later.transpose(0, 2, 1)
        together = np.einsum("nij,njk->ik", parts, cross)
        left[order] += _less(shared[order], moves[order], carry[order] @ cross, together)
    return np.asarray((left + left.transpose(0, 2, 1)) / 2.0)


def _less(
    own: np.ndarray, moves: np.ndarray, with_motion: np.ndarray, motion: np.ndarray
) -> np.ndarray:
    """Covariance of e - A m, from those of e, of e with m, and of m."""
    part = with_motion @ moves.transpose(0, 2, 1)
    whole = own - part - part.transpose(0, 2, 1) + moves @ motion @ moves.transpose(0, 2, 1)
    return np.asarray(whole)
