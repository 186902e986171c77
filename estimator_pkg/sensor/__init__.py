# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""What a reading is worth, once for all observers: guard, clock, quantum and noise."""
