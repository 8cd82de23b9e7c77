"""The human half: a page in a browser or a headset, served by a process that cannot delay the control loop."""
