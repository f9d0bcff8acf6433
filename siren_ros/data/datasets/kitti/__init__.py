"""KITTI: the object benchmark's own layout, and the paper's."""
