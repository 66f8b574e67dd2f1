"""Navigation: from a laser, odometry and a map to a velocity, as periodic tasks on the robot's schedule."""
