"""Simulated plants, sensors with faults, simulator nodes and the reproductions of the papers."""
