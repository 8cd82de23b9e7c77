"""Onboard software of a 360° mobile telepresence robot."""

__version__ = "0.1.0"
