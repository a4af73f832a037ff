"""Robot models: which humanoids there are, and what a simulated body and the planners need of each.

Read in this order: `description` (what a URDF does not say), `catalogue` (read from TOML files), `installed` (where its URDF is), `urdf` (links and
joints of a URDF, merged into a kinematic tree), `hulls` (its links as convex solids), `leg_kinematics` (joint angles of a
leg for a place of its foot), `jointed` (all of these, joined).

The models come from the distribution `example-robot-data`; none is part of this project.
"""
