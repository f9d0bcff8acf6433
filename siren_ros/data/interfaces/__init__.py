"""Topics and the paired conversions between our structures and ROS messages, written without ROS."""
