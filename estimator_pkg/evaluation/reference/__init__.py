"""What velocities are compared with where there is no truth."""
