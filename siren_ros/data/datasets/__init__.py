"""Exporters to published formats, one file per format or family of formats."""
