"""Experiments of seed 003: floor detection, egocentric grid, path search and exploration."""
