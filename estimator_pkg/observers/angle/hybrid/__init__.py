"""The hybrid observer of wrapped angles."""
