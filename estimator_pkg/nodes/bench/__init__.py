"""What the live node costs and loses, measured over real DDS beside a null node."""
