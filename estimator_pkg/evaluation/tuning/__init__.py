"""Gains from data: the command, what is minimised, the search, and what it leaves behind."""
