"""Fitting of the sequence model; needs torch."""
