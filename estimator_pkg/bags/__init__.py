# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Reading, writing, recording, playing and replaying of bags."""
