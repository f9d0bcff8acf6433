"""What any driver does: follows a path, keeps a speed, watches for collisions, changes lanes."""
