"""Obstacles: points to clusters, clusters to detections, detections to tracks.

Read in this order: `clustering` with `circle_fit` (points to obstacles), `colour_detection` (obstacles of known
colours), `track` (the filter of one obstacle) with `habits` (what is learnt of its motion), `record` (whether the world
shows that it moves), `tracker` (data association, birth and death), `forecast` (where it will be).

Source: Yoo and Kim 2010 (seed 001), sections 2, 3, 14 and V-A.
"""
