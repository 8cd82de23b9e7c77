"""The lidar as an async context manager that keeps its link alive and yields scans."""
