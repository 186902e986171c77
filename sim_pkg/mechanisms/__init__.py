"""Mechanisms that move by their equations, and the encoders that read them."""
