"""Training of the risk task's sequence model: films of drawn episodes, fitting, card."""
