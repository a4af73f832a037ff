"""Whole recordings: map, panorama, monocular floor, smoothing."""
