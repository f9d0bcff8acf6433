"""The only library code that knows ROS."""
