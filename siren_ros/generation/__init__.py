"""Episodes: set up one by one, or many."""
