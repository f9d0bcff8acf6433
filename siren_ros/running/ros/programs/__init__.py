"""Programs around nodes: start, composition, progress, summary, end."""
