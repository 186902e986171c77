# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""For `driver.old_joint` alone, and to be deleted with it."""

from estimator_pkg.sensor.guard import longest_dt as longest_dt
