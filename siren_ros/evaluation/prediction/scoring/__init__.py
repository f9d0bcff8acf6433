"""Predictors scored on episodes: a value for each metric and sample."""
