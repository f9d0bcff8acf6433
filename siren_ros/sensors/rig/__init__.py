"""A whole suite in one world: all measurements that are due at a step; roadside stations."""
