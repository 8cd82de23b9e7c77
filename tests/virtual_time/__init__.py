"""The real driver, safety chain and loop against the simulated base in simulated time, on one thread.

`clock` is the event loop that never waits, `wire` the bus that it runs over, `checker` an independent judge of
the frames on it, `chain` the robot around it and `stage` the people and devices around the robot.
"""
