"""The simulation: a world to try it in, a robot that walks there, and a truth to judge by.

Read in this order: `shapes` and `scenes` (what stands and moves, as values), `home` and `rooms` with
`furniture`, `tags` and `free_space` (how scenes are made from a seed), `scene_file` and `model_files` (scenes
that a user writes), `scene_table` and `scene_checks` (whether they can be), `textures`, `painting` and
`pictures` (what they look like), `rays` (how far items are), `world` (a scene with a clock), `gait` (footsteps to motion), `body` (what slip and sway add), `dynamic`
(the body that really walks instead), `head`, `inertial`, `cameras`, `tof_camera` (the sensors),
`geometric_sensor` (all that in a hundredth of the time, for long studies), `robot` (all of it, as something
to drive), `solid` and `truth` (for evaluation alone).

It knows the words of the project and none of its algorithms. Truth leaves it through `truth` only.

Sources: seed 000 (gait command, instants of the images, robots to and fro), seed 003 (stereo pair),
seed 004 (time-of-flight camera); measures of a DARwIn-OP.
"""
