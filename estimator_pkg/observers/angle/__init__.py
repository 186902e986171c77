"""Observers of one angle."""
