"""ROS 2 nodes. No mathematics: samples go to the driver, estimates come back."""
