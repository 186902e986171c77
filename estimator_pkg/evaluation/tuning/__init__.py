# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Gains from data: the command, what is minimised, the search, and what it leaves behind."""
