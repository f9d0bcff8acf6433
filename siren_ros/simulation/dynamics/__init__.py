"""Motion of vehicles: vehicle model, tracking, collisions."""
