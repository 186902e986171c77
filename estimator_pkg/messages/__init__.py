# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""CDR bytes of the few message types we handle, decoded and encoded without ROS.

Nodes subscribe raw and publish bytes, bags hold bytes: both go through the same functions.
"""
