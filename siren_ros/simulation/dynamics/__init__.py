"""How a vehicle moves: vehicle models, tracking, collisions."""
