# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""``bench speed``: the live nodes over real DDS, compared with a node that only republishes."""
