"""What exists at a step: actors, traffic states, commands, events, ground truth (arrays sorted by ``actor_id``)."""
