"""Predictions that other programs made: files, messages."""
