"""Finds parameter files, and reads YAML with checks that name the line."""
