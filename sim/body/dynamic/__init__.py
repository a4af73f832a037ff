"""A body with dynamics: servos, soles and gravity instead of exact footsteps.

Read in this order: `anatomy` (lengths and masses), `legs` (inverse and forward kinematics), `balance` (attitude
estimate, ankle feedback, landing), `capture` and `hip_strategy` (recovery from pushes), `physics` (what the body asks
of an engine), `urdf` and `pybullet_engine`, `mjcf` and `mujoco_engine` (the same body in two engines), `engines`
(these by name), `odometry` (foot to foot, by encoders), `servo_body` (what it shares with described robots), `config` and `walker` (the body).

The footsteps come from `sim.body.gait`, as for the kinematic body.

Sources: seed 000 (footstep command), seed 001 (control period), seed 003 (odometry), seed 004 (the tall body);
Kajita et al. (legs); gains and figures from walking trials with the dimensions of a DARwIn-OP.
"""
