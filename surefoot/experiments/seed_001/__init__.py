"""Figures and trials of Yoo and Kim 2010: univector field navigation and gaze control."""
