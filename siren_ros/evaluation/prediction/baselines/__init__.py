"""Predictors that are not learned: constant velocity, IDM."""
