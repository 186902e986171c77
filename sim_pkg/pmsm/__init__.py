# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A permanent-magnet motor with its drive: plant, inverter, controller, and the simulator."""
