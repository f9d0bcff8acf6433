"""The seat of the AV under test: what is seen from it, its way, its pedals and wheel."""
