"""A body with dynamics for robots that are described by a URDF.

Read in this order: `tree` (the moving links with their masses, inverse kinematics), `dynamics_filter` (the centre of
mass moved until the whole body's ZMP is the planned one), `foot_forces` (the weight shared as planned), `waist` (gaze
joints that the walk knows before), `model` (what the engine loads), `walker` (the body), `joints` (angles for cameras).

The footsteps come from `sim.body.gait`, attitude, ankles and landing from `sim.body.dynamic.balance`, as for our own robot.

Sources: Kajita et al. 2003 (ZMP of the whole body corrected by a second pass over the preview); Kajita et al. 2010 (foot
force difference); gains from walking trials with the models of `sim.robots`.
"""
