"""The labelled staircase of the time-of-flight set, by its plane regions."""

from __future__ import annotations

import numpy as np

from perception.terrain import segmentation
from surefoot.experiments.real import labelled_steps
from surefoot.experiments.real.labelled_steps import (
    NO_UNITS,
    RISERS,
    TREADS,
    WHOLE,
    images,
    overlaps,
)


def test_the_labelled_risers_and_the_thin_tread_are_regions_of_their_own(recordings, monkeypatch):
    monkeypatch.setenv("SUREFOOT_DATA", str(recordings))
    depth, labels = images()
    regions = segmentation.find(depth, WHOLE, NO_UNITS, "tof")
    masks = [one.mask(depth.camera) for one in regions]
    assert np.mean(overlaps(masks, labels, RISERS)) > 0.85
    assert overlaps(masks, labels, TREADS)[0] > 0.85  # of four rows
    best = [int(np.argmax([(m & (labels == one)).sum() for m in masks])) for one in RISERS]
    assert len(set(best)) == len(RISERS)


def test_the_nosings_are_straight_lines_through_the_lens(recordings, monkeypatch):
    monkeypatch.setenv("SUREFOOT_DATA", str(recordings))
    depth, labels = images()
    camera, q = depth.camera, 1.0 / depth.z.astype(np.float64)
    level = {riser: np.nanmedian(q[labels == riser]) for riser in RISERS}
    for above, below in ((201, 200), (200, 137), (137, 155), (155, 123), (123, 122)):
        middle = (level[above] + level[below]) / 2.0
        nosing = []
        for u in range(12, 112):
            rows = np.flatnonzero(np.isin(labels[:, u], (above, below)))
            near = q[rows[0] : rows[-1] + 1, u]
            k = int(np.flatnonzero((near[:-1] <= middle) & (near[1:] > middle))[0])
            nosing.append((u, rows[0] + k + (middle - near[k]) / (near[k + 1] - near[k])))
        x, y, _ = camera.back_project(np.array(nosing, np.float64), np.ones(len(nosing))).T
        off_px = camera.fy * (y - np.polyval(np.polyfit(x, y, 1), x))
        assert np.sqrt(np.mean(off_px**2)) < 0.5


def test_without_the_recording_nothing_is_scored(tmp_path, monkeypatch):
    monkeypatch.setenv("SUREFOOT_DATA", str(tmp_path))
    said = []
    figures, table = labelled_steps.scores(said.append)
    assert figures == {}
    assert "not measured" in table[0]
    assert "dpd_planes" in said[0]


def test_overlap_counts_labelled_pixels_only():
    labels = np.array([[110, 110, 0, 198]])
    mask = np.array([[True, True, True, False]])
    assert overlaps([mask], labels, (110, 198)) == [1.0, 0.0]
