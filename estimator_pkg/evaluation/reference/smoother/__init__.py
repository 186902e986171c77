# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The off-line reference: a smoother with its own standard deviation."""
