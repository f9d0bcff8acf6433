"""The lockstep's decisions: when a step is complete, which inputs belong together. No ROS."""
