"""The edge-aware adaptive observer."""
