"""Calls libsumo: reads vehicles and signals, sets what the episode needs, mirrors poses into SUMO."""
