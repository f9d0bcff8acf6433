"""Studies: many episodes from one description, run side by side, kept with one row each in one table."""
