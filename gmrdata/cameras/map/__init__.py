"""Cameras and points from matches."""
