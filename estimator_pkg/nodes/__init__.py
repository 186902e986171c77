# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""ROS 2 nodes. No mathematics: samples go to the driver, estimates come back."""
