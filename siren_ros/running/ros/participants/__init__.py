"""Nodes that take part in the lockstep, and the master that drives it."""
