"""A permanent-magnet motor in its drive: plant, inverter, controller, and what it publishes."""
