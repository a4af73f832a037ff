"""Scenes: generators from a name and a seed, and scenes from a user's file.

Read in this order: `catalogue` (loading by name), `difficulty`, `rooms` (walls, plain scenes), `tags` (landmarks),
`free_space` (clearance maps), `furniture`, then the generators `home`, `flat`, `public_places`, `course`,
`seed_rooms`, `avoidance_scenes`, `plain_room`. User files: `scene_file` with `scene_table`, `scene_checks` and
`model_files`.
"""
