"""Joints that move by a profile or are driven by an input, and the sensors that read them."""
