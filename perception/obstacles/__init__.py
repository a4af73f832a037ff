"""Obstacles: points to clusters, clusters to detections, detections to tracks."""
