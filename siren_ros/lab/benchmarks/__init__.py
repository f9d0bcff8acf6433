"""Benchmarks: commands that measure on this machine and print the figures."""
