"""Observers of mechanisms with a known model and known inputs."""
