"""Shadows, lamps on ground and walls, rain."""
