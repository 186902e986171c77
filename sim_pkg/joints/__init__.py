"""Joints that follow a profile or are driven by an input, and the sensors that measure them."""
