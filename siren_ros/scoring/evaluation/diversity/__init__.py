"""How different episodes are, and what more seeds would still add."""
