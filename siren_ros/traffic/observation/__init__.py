"""Conclusions from SUMO's states: stop lines crossed, reactions to the EMV, teleports, bounds on residuals."""
