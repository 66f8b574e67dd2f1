"""The book's processes (ROS nodes) on the robot's schedule: topics, timers, parameters and lifecycle."""
