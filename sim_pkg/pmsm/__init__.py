"""A permanent-magnet motor with its drive: plant, inverter, controller, and the simulator."""
