"""Runs episodes: one without ROS or as nodes, with an AV under test, or many in a study."""
