"""What a sensor suite is: mounts, sensors, noise, and the look of the weather."""
