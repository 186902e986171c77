"""The sensorless observer of permanent-magnet motors."""
