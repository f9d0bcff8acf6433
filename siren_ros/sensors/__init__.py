"""What sensors see: the 3-D scene, LiDAR, cameras, ground truth."""
