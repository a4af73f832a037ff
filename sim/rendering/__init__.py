"""Images and ranges of a scene.

Read in this order: `textures` (procedural materials), `painting` (textured meshes), `renderer` (PyBullet's renderers),
`pictures` (camera images), `surfaces` and `numbered` (ranges from PyBullet's camera), `rays` (ray casting by Embree),
`lens` and `motion` (distortion and exposure), `_visibility_kernels` (occlusion of discs).
"""
