"""Bodies that walk by footsteps.

Read in this order: `body` (the interface), `gait` (footsteps to trajectories of feet and centre of mass), `head` (pan
and tilt joints), `inertial` (gyro and accelerometer), `kinematic` (exact footsteps with drawn slip and sway), and the
package `dynamic` (servos and soles in a physics engine).

Sources: seed 000 (footstep command); Kajita et al. 2001 (linear inverted pendulum).
"""
