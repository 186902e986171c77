"""Super-twisting differentiators."""
