# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Barbot, Djemai, Manamanni: the observer of a hybrid continuous-discrete system."""
