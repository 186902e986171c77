"""Estimates against truth: matched, measured, told."""
