"""Frames to and from a bus: python-can behind a protocol of three methods."""
