"""A small ``ros2`` for machines without a ROS installation: run, pkg, topic and bag, as far as this project needs them.

The environment puts it on the PATH only where no real ``ros2`` is. Arguments and output follow the real one; a verb is
imported only when it is used, so that ``ros2 run`` starts at once.
"""
