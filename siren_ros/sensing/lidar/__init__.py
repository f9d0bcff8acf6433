"""The LiDAR: rays cast by Embree, returns, drop-off, noise."""
