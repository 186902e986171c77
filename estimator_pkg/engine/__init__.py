# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The functions of records as C99: the translator, the build and the calls.

`translate`, `entries` and what they import use the standard library alone, and relative imports:
setup.py runs them by path, where neither the package nor numpy is installed. See docs/engine.md.
"""
