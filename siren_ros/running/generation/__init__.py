"""One episode: its setup from a request, its run without ROS, its repetition for a check."""
