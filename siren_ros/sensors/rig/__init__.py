"""A whole suite in one world: measures what is due at a step; roadside stations."""
