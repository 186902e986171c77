# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Simulated plants, sensors with faults, simulator nodes and the reproductions of the papers."""
