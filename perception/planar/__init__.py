"""Localisation of wheeled robots on a plane, with known and unknown landmarks.

Read in this order: `config` (noise parameters), `planar` (filter with odometry and landmarks, whose systematic
errors are part of the state), `planar_fit` (parameters by maximum likelihood, without ground truth) and
`association` (landmarks without identity). A log that nobody tuned: `planar_log` (odometry, and sightings or ranges),
`fix` (a pose out of nothing) and `log_localiser` (lost, found, followed, locked out). Compiled loops are in
`_planar_kernels` and `_association_kernels`.

Source: Yoo and Kim 2010 (seed 001), sections 2 and 3; the states of systematic errors are ours.
"""
