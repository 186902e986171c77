"""The demonstration: simulator and observer as processes over real DDS, displayed and recorded."""
