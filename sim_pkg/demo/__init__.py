# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The demonstration: simulator and observer as processes over real DDS, displayed and recorded."""
