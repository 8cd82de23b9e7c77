"""Detectors: a picture in, named boxes out; chosen by name with `base.make_detector`."""
