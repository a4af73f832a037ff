"""Ground of several levels: the surfaces round the robot that a foot may stand on, fused from its depth images.

`surface` holds the values. `perception.terrain` measures them in one image.

Source: ours.
"""
