"""The observer of systems that switch at known events."""
