"""The labelled staircase of the time-of-flight set, by its plane regions."""

from __future__ import annotations

import numpy as np

from perception.terrain import segmentation
from surefoot.experiments.real import labelled_steps
from surefoot.experiments.real.labelled_steps import NO_UNITS, RISERS, WHOLE, images, overlaps


def test_the_labelled_risers_are_regions_of_their_own(recordings, monkeypatch):
    monkeypatch.setenv("SUREFOOT_DATA", str(recordings))
    depth, labels = images()
    regions = segmentation.find(depth, WHOLE, NO_UNITS, "tof")
    masks = [one.mask(depth.camera) for one in regions]
    assert np.mean(overlaps(masks, labels, RISERS)) > 0.85
    best = [int(np.argmax([(m & (labels == one)).sum() for m in masks])) for one in RISERS]
    assert len(set(best)) == len(RISERS)


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
