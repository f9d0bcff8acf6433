"""Nodes of the lockstep, and the master that controls it."""
