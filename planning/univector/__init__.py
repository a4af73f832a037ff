"""How to walk to a via point among obstacles: the univector field.

Read `fields`: the move-to-goal field (MUF), the avoid-obstacle field (AUF), and their sum. Compiled loops
are in `_kernels`.

Source: seed 001, section 4, eq. (7) to (10).
"""
