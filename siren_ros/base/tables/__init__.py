"""Tables of results: intervals, cells, and their output for terminals, files and pages."""
