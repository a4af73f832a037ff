"""Runs against the truth."""
