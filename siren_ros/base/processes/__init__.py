"""Runs work in other processes or in parallel: progress, killed and hanging workers, order of results."""
