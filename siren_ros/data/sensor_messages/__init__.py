"""Measurements of a suite as topics, frames and messages of its carrier."""
