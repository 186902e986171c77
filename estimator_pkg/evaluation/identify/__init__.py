"""A model's numbers from recordings."""
