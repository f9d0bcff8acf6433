"""Topics, and paired conversions between our structures and ROS messages. This folder does not need ROS."""
