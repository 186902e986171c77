# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Aranovskiy, Ortega, Romero, Sokolov: the observer of mechanisms."""
