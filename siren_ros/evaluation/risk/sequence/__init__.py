"""A small network that judges a film of the front camera: the reference that sees pictures and is no language model."""
