# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Checks of a measurement without truth: its stamps, its readings, and what they allow."""
