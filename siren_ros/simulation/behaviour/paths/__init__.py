"""Paths to drive: curves along lanes, blends from one to another, the nearest place on a lane."""
