"""Compare estimates with the truth: match, measure, describe."""
