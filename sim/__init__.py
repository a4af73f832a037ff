"""The simulation: scenes, a robot that walks in them, its sensors, and the ground truth.

Read in this order: `shapes` and `scene` (values), `scenes` (generators, files and checks), `rendering` (pictures and
ray casting), `world` (a scene with a clock), `body` (footsteps to motion; kinematic or dynamic), `sensors` (cameras,
time of flight, and a fast geometric sensor), `robot` (a body with its sensors), `contact` and `truth` (for evaluation
only).

The simulation uses `perception.primitives` and `planning.commands`, no algorithms. Ground truth leaves it only through
`truth`.

Sources: seed 000 (footstep command, image times, moving robots), seed 003 (stereo pair), seed 004 (time-of-flight
camera); dimensions of a DARwIn-OP.
"""
