"""From access units to what is around the robot: decode, detect, directions, wedges."""
