"""Simulated sensors with their errors."""
