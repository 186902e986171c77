"""Reference velocity, metrics, comparison."""
