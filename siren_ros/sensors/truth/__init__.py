"""Exact labels: 3-D boxes with LiDAR points, 2-D boxes with visible pixels."""
