"""The driver: takes samples through guard and observer, for the live node and off line alike."""
