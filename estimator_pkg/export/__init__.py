# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Tuned observers as C99 headers, for firmware and C++. See docs/firmware.md."""
