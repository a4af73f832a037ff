"""Maps and clouds as files.

Read `atomic_write` (a file is complete or absent), `grid_file` (the terrain map with all its layers), `nav2`
(occupancy maps for ROS), `geotiff` (layers for GDAL and QGIS), `world_file` (all files of a world map) and `clouds` (the coloured cloud of a run, PLY).
"""
