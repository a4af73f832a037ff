"""Pictures of a world: two renderers, lenses, motion."""
