"""Navigation for robots that implement the protocol `btcore_robot.robot.Robot`."""
