"""Paths of vehicles: curves along lanes, transitions between them, nearest positions on lanes."""
