"""Planners: from a world model to the next footstep.

Read in this order: `planner` (the protocol), `settings` and `mission` (what planners are given), `goals` and
`timed_goals`, `search_planner` (the default), `field_planner`, `swarm_planner`, `avoidance_planner` with
`panorama_obstacles`, `stuck_recovery` and `depth_loss_fallback` (planners around a planner), `factory` (planners by name).

Sources: seeds 000, 001, 003 and 004 as noted in each file.
"""
