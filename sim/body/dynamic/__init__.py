"""The body that really walks: servos, soles and gravity instead of exact footsteps.

Read in this order: `anatomy` (one table of lengths and masses), `urdf` (what PyBullet reads), `legs` (where
feet shall be to joint angles, and back), `balance` (attitude, ankles, landing), `physics` (PyBullet),
`odometry` (foot to foot, by encoders), `walker` (all of it, answering what the kinematic body answers).

The footsteps come from `sim.body.gait`, the same engine as the kinematic body's.

Sources: seed 000 (footstep command), seed 001 (period of control), seed 003 (odometry), seed 004 (the tall
body); Kajita et al. (legs); gains and figures from walking trials with a DARwIn-OP's measures.
"""
