# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Mechanisms integrated from their equations of motion, and the encoders that measure them."""
