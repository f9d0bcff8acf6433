"""Predicts where vehicles will go, where their paths meet, and who waits there."""
