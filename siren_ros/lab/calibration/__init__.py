"""Fits the EMV's parameters, SUMO's and the controller's, to trajectories."""
