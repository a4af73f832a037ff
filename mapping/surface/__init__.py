"""Dense surfaces.

Read `tsdf_config` (settings and the protocol `SurfaceMap`), `tsdf` (our map of truncated signed distances),
`tsdf_open3d` (the same by Open3D), `surface_map` (the factory), `meshes` (the result and its file) and
`traversability` (height, slope, step and foothold probability per cell).

Sources: Curless and Levoy 1996; Nießner et al. 2013; Gibson 1998; Wermelinger et al. 2016.
"""
