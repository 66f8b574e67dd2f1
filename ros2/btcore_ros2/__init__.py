"""ROS 2 for behavior trees: leaves, servers, a robot over topics, and the simulated robot on ROS 2."""
