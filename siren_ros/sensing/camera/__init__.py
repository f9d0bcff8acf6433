"""Draws camera pictures with OpenGL. Imports go down: ``camera``, ``renderer``, light, geometry, ``shaders``."""
