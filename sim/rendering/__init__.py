"""Images and ray casting of a scene.

Read in this order: `textures` (procedural materials), `painting` (textured meshes), `pictures` (PyBullet's renderers),
`lens` and `motion` (distortion and exposure), `rays` (ray casting by Embree), `_visibility_kernels` (occlusion of
discs).
"""
