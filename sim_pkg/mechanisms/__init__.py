"""Mechanisms integrated from their equations of motion, and the encoders that measure them."""
