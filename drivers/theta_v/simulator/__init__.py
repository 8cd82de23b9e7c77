"""A THETA V from the wire's point of view: one camera model behind two fronts (in-process and USB/IP)."""
