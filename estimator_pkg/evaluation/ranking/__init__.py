# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Rank velocity estimates without ground truth: verdict, pairs, cautions."""
