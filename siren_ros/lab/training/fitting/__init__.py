"""The network and its fitting: the part of the training that needs torch, loaded by name when it is asked for."""
