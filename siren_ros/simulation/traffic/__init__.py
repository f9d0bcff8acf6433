"""SUMO's traffic: the demand, the running simulation, what is concluded from its states."""
