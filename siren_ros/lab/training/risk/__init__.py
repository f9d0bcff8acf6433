"""Trains the sequence model of the risk task: films of drawn episodes, fitting, card."""
