"""Trains the shipped models. Only this folder and that of published predictors use torch."""
