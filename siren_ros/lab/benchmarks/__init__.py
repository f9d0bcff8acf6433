"""Benchmarks: commands that print figures measured on this machine."""
