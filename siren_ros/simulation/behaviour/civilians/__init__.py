"""Civilians (paper, Algorithm 2): which of them yield, how, and how they return to traffic."""
