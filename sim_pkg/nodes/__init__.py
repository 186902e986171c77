"""Simulator nodes: thin shells around the simulations of sim_pkg."""
