"""Mechanical and motor models that model-based observers need."""
