"""Vertex buffers of the static scene and of vehicles."""
