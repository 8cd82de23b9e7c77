"""The robot's log: one Rerun recording per run, written beside the control loop and read back exactly."""
