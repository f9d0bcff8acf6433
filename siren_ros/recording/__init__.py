"""Episode bags: written, read, verified."""
