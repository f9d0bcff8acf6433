"""Point clouds as numpy arrays, with the interface of ROS's package of this name; PyPI lacks that package."""
