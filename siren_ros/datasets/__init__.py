"""Exporters to published formats."""
