"""Image features: keypoints, orientations, descriptors, and their matching.

Read `gaussian_hermite` (moments used as gradients), `mdghm_sift` (SIFT with them, and OpenCV's SIFT with the same
signature), `pictures` (range and amplitude as images with enough contrast), and `matching`. Compiled loops are in
`_scale_space_kernels` (extrema), `_orientation_kernels` and `_descriptor_kernels`.

Source: Kang et al. 2013 (seed 004), section 2.2.1; Lowe 2004 for the rest of SIFT.
"""
