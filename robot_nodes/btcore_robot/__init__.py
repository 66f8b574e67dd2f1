"""Leaves, navigation and programs for robots that implement the protocol `btcore_robot.robot.Robot`."""
