"""The robot's mind: leaves and programs that ask a body for what `btcore_robot.robot.Robot` promises."""
