"""Decisions of drivers: the EMV and the civilians (paper, Algorithms 1 and 2)."""
