"""Tables of results: intervals, cells, and how a terminal, a file and a page show them."""
