"""Bosso, Azzollini, Tilli: the sensorless observer of a motor."""
