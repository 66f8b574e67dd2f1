"""Navigation with laser, odometry and map, as periodic tasks on the robot's schedule."""
