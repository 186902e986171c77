# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Brentari, Bosetti, Zaccarian: the hybrid observers of an angle."""
