"""Controllers that compute commands from sensor data, without a tree.

They are the controllers of the book *A Concise Introduction to Robot Programming with ROS2*.
"""
