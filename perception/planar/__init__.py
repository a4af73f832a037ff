"""Localisation of wheeled robots on a plane, with known and unknown landmarks."""
