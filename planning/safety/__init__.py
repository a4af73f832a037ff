"""The guard: steps that stay clear of what stands and of what may move."""
