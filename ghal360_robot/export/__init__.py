"""A recorded run for other tools: MP4, CSV, and MCAP with ROS 2 messages."""
