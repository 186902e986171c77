"""Barbot, Djemai, Manamanni: the observer of a hybrid continuous-discrete system."""
