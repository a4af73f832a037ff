"""Occupancy: the egocentric grid, the world map, how fresh their cells are."""
