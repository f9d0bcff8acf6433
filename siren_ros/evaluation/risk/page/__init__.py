"""One HTML page of a set of risk videos: each plays next to its label, its measures over time and the answers."""
