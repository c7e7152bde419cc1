"""ROS 2 without ROS, and fleets."""
