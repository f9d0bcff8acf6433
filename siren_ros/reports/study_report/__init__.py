"""A study as one HTML page: what was generated, what was measured, and the command for each number."""
