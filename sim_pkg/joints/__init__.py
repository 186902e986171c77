# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Joints that follow a profile or are driven by an input, and the sensors that measure them."""
