"""GLSL of surfaces, sky and vehicles."""
