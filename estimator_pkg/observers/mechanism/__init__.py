"""Observers of mechanisms whose model and input are known."""
