"""One episode: set up from a request, run without ROS, repeated for a check."""
