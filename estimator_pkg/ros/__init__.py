"""What rclpy needs to be a good host: environment, executor, domain, losses, remote parameters."""
