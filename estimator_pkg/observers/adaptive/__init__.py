"""The observer of servos whose parameters it identifies."""
