# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""What rclpy needs to be a good host: environment, executor, domain, losses, remote parameters."""
