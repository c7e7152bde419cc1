"""One file of settings for all lidars of a robot: read by every verb and by `open_lidar`, written by the page."""
