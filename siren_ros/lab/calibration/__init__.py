"""Fits parameters of the EMV (SUMO's and the controller's) to trajectories."""
