"""Simulator nodes: thin ROS 2 wrappers around the simulators of sim_pkg."""
