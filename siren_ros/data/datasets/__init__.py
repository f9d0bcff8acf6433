"""Exporters to published formats, one file or folder per format."""
