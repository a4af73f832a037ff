"""Movers: the laws by which the moving objects of a scene move.

Read in this order: `law` (what a law is, and the names), `ground` (where a mover may be), the laws in `lines`,
`waypoints`, `curves`, `company` and `social_force`, then `traffic` (all movers of a scene in one clock) and
`population` (a scene whose movers follow other laws).

No law knows anything of perception and planning, and nothing of them may know a law.
"""
