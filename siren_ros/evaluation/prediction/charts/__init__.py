"""Pictures of scores and of single predictions."""
