"""The driver: passes samples through guard and observer, for the live node and off line."""
