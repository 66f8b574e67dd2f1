"""The robot's mind: leaves and programs that ask a body for what `robot_nodes.robot.Robot` promises."""
