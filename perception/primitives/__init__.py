"""Values shared by all packages: frozen dataclasses with their algebra, which import nothing else of the project.

Read `errors`, `pose`, `camera`, `gaussian`, `plane`, `obstacle`, `landmark`, then `frame`, which joins them into one
instant of the sensors; `settings` marks the fields of a configuration that a user may set.
"""
