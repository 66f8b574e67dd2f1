"""Bags of ROS 2, written and read without ROS. No module of this package is public: use `btcore.logs`."""
