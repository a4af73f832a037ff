"""Runs: the pipeline, the walking loop, and what is written down."""
