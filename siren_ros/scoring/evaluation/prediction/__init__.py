"""Trajectory prediction by the paper's protocol."""
