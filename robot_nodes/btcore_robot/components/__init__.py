"""Components on the robot's schedule: topics, timers, parameters and lifecycle.

A component corresponds to a ROS 2 node in the book *A Concise Introduction to Robot Programming with ROS2*.
"""
