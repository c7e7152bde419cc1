"""Simulated devices: what they share, and how they are served; the devices themselves live in their families."""
