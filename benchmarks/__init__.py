"""Benchmarks of speed and accuracy against named peers."""
