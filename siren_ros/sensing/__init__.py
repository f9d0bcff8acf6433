"""Simulates what sensors measure in a 3-D scene. This wing knows neither topics nor messages."""
