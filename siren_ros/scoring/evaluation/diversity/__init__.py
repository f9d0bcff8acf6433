"""Measures how different episodes are, and what more seeds would add."""
