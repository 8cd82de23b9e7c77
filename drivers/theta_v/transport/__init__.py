"""How bytes reach the camera: one small protocol, and who implements it."""
