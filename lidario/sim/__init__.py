"""What simulated devices share, and how they are served; the devices themselves are in their families' folders."""
