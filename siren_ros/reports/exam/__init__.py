"""Grades how a driver behaves before an emergency vehicle, by a rulebook of clauses."""
