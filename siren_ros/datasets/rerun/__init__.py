"""Rerun: one file that shows an episode on a timeline."""
