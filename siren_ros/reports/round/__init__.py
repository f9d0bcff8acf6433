"""Rounds: sealed episodes, their questions, a board of the submissions, and its verification by anybody."""
