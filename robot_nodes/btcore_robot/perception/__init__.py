"""Detection of objects and obstacles in sensor data.

The methods are from the book *A Concise Introduction to Robot Programming with ROS2*.
"""
