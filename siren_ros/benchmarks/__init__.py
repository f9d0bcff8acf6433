"""Benchmarks: commands that print figures of this machine."""
