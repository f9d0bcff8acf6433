"""Metrics of trajectory prediction, one function each."""
