# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Gonzalez-Olvera, Tang: the adaptive observers."""
