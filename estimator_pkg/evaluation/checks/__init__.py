# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Checks of one joint's stamps and readings, and the reference that they allow."""
