"""Simulates the LiDAR: Embree casts the rays; loops compute returns, drop-off and noise."""
