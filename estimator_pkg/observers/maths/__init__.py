"""Textbook algorithms that several families of observers use."""
