"""Brentari, Bosetti, Zaccarian: the hybrid observers of an angle."""
