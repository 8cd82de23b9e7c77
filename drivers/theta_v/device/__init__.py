"""The camera as the robot uses it: connect, negotiate, stream, recover."""
