"""Where the sensors sit on the robot, and (later) how to measure it."""
