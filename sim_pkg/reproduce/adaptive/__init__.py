"""Gonzalez-Olvera, Tang: the adaptive observers."""
