"""Textbook parts that several families use."""
