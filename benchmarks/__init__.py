# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Benchmarks of speed and accuracy against named peers."""
