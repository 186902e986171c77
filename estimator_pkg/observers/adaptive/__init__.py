"""The observer of servos that identifies their parameters."""
