"""Studies: many episodes from one description, made in parallel, with one table of results."""
