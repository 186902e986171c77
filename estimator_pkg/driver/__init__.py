# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The driver: passes samples through guard and observer, for the live node and off line."""
