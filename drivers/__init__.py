"""Direct drivers of the robot's three devices; each stands alone and imports nothing else of this project."""
