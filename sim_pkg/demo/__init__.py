"""The demonstration: simulator and observer as processes over real DDS, watched and recorded."""
