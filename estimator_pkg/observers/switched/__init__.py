"""The observer of systems that known events switch."""
