"""The only folder of the library that uses ROS."""
