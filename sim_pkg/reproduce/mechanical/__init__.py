"""Aranovskiy, Ortega, Romero, Sokolov: the observer of mechanisms."""
