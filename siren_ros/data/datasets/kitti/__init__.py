"""KITTI export: the layout of the object benchmark, and the paper's layout."""
