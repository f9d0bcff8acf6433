"""Writes prediction scores as tables and files, beside the paper's."""
