# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Simulator nodes: thin ROS 2 wrappers around the simulators of sim_pkg."""
