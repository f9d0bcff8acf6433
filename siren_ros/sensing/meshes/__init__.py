"""Triangles with materials, the shapes they are built from, and where vehicles' meshes stand at a step."""
