"""Decisions of the lockstep: when a step is complete, which inputs belong together. No ROS."""
