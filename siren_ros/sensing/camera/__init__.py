"""Camera pictures through OpenGL; imports go down: ``camera``, ``renderer``, light, geometry, ``shaders``."""
