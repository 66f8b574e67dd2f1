"""The book's processes (ROS's "nodes") on the robot's schedule: topics, timers, parameters, lifecycle."""
