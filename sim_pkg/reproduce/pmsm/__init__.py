# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Bosso, Azzollini, Tilli: the sensorless observer of a motor."""
