"""Writes prediction scores as tables and files, with the paper's."""
