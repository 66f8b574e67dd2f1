"""Leaves, navigation and programs for robots that implement the protocol `btcore_robot.robot.Robot`.

In this package "the book" is *A Concise Introduction to Robot Programming with ROS2*.
"""
