"""The off-line reference: a smoother with its own standard deviation."""
