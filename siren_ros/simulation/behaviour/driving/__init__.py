"""Common abilities of all drivers: following a path, speed control, collision watch, lane changes."""
