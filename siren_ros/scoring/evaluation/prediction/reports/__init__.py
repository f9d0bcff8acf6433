"""Scores as tables and files, next to the paper's."""
