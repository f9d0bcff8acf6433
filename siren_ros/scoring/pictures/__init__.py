"""Draws pictures and videos of recorded episodes."""
