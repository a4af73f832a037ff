"""The scenes: generators by name, scene files, and their checks."""
