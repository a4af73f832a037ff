"""Surfaces: signed distance volumes, meshes, where one can walk on them."""
