# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Reproductions of the papers: figures and tables, our results next to the printed ones."""
