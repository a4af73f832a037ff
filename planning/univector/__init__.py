"""How to walk to a via point among obstacles: the univector field.

In reading order: `fields` (the move-to-goal field MUF, the avoid-obstacle field AUF, their sum, and `FieldConfig`
with a switch for each addition), `collision` (which speeds lead into a mover, and how doubt widens them), `speed`
(passing before it, behind it, or out of its way), `virtual_obstacle` (turning aside early where no speed helps),
`motion` (all of that as one decision: heading and speed). Compiled loops are in `_kernels`.

Source: seed 001, section 4, eq. (7) to (11).
"""
