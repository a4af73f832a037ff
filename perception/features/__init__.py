"""Features: places in an image that are found again from elsewhere, and what they look like.

Read `gaussian_hermite` (the moments that stand in for gradients), then `mdghm_sift` (SIFT with them, our
own from scale space to descriptor, and OpenCV's behind the same signature), `pictures` (range and
amplitude as pictures with enough contrast to find anything), and `matching` (which feature is which).
Compiled loops are in `_scale_space_kernels` (extrema), `_orientation_kernels` and `_descriptor_kernels`.

Sources: seed 004, section 2.2.1; Lowe 2004 for the rest of SIFT.
"""
